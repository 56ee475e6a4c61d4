from __future__ import annotations

from pathlib import Path

import pytest

from lab.gpu.records import LATE, MEASURED, Record, Run, without_places


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("cannot open /some/where/data.bin", "cannot open data.bin"),
        ('File "/opt/x/y-1.0/z.py", line 3', 'File "z.py", line 3'),
        ("in ~/made/up/file", "in file"),
        ("in /made/up/", "in a folder"),
        ("0.5 / 2, and/or, 3/4", "0.5 / 2, and/or, 3/4"),
        ("https://docs.nerf.studio/a/b", "https://docs.nerf.studio/a/b"),
        (
            "see docs/results/gpu.md and tests/backend/x.py",
            "see docs/results/gpu.md and tests/backend/x.py",
        ),
    ],
)
def test_texts_name_no_folders_of_a_machine(text, left):
    assert without_places(text) == left


def test_what_is_saved_is_loaded_again(tmp_path: Path):
    record = Record(LATE, 3.5, 3.0, "ended after 3 s", {"rows": [1, 2]}, ["a line"])
    run = Run("cuda", False, {"machine": record, "suite": Record()})
    assert Run.load(run.save(tmp_path)) == run
    assert [path.name for path in tmp_path.iterdir()] == ["gpu.json"]


def test_a_run_goes_on_with_what_the_same_code_measured_on_the_same_gpu():
    done, late = Record(MEASURED, figures={"answer": 42}), Record(LATE, figures={"half": 1})
    earlier = Run("cuda", False, {"machine": done, "suite": late}, "a commit on a GPU")
    assert Run("cuda", False, made_by="a commit on a GPU").goes_on(earlier) == {"machine": done}
    assert Run("cuda", False, made_by="a commit on another").goes_on(earlier) == {}
    assert Run("cuda", True, made_by="a commit on a GPU").goes_on(earlier) == {}


@pytest.mark.parametrize(
    ("device", "quick", "stands_in"),
    [("cuda", False, False), ("cuda", True, True), ("cpu", False, True), ("cpu", True, True)],
)
def test_only_a_whole_run_on_a_gpu_means_anything(device, quick, stands_in):
    assert Run(device, quick).is_stand_in is stands_in
