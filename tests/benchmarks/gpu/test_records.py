from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.gpu.records import LATE, Record, Run, without_places


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("cannot open /some/where/data.bin", "cannot open data.bin"),
        ('File "/opt/x/y-1.0/z.py", line 3', 'File "z.py", line 3'),
        ("in ~/made/up/file", "in file"),
        ("in /made/up/", "in a folder"),
        ("0.5 / 2, and/or, 3/4", "0.5 / 2, and/or, 3/4"),
        ("https://docs.nerf.studio/a/b", "https://docs.nerf.studio/a/b"),
        ("see docs/gpu.md and tests/backend/x.py", "see docs/gpu.md and tests/backend/x.py"),
    ],
)
def test_texts_name_no_folders_of_a_machine(text, left):
    assert without_places(text) == left


def test_what_is_saved_is_loaded_again(tmp_path: Path):
    record = Record(LATE, 3.5, 3.0, "ended after 3 s", {"rows": [1, 2]}, ["a line"])
    run = Run("cuda", False, {"machine": record, "suite": Record()})
    assert Run.load(run.save(tmp_path)) == run
    assert [path.name for path in tmp_path.iterdir()] == ["gpu.json"]


@pytest.mark.parametrize(
    ("device", "quick", "stands_in"),
    [("cuda", False, False), ("cuda", True, True), ("cpu", False, True), ("cpu", True, True)],
)
def test_only_a_whole_run_on_a_gpu_means_anything(device, quick, stands_in):
    assert Run(device, quick).is_stand_in is stands_in
