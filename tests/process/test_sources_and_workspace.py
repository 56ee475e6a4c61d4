"""What may be processed, and what is kept of a call."""

from __future__ import annotations

from pathlib import Path

import pytest

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.process.request import Request
from desplat_ns.process.sources import find_sources
from desplat_ns.process.workspace import open_workspace


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


def test_photos_in_folders_are_found_and_raw_twins_and_the_output_are_not(tmp_path):
    names = ("b ü.jpg", "a/1.PNG", "a/2.cr2", "b ü.dng", "note.txt", ".x.jpg", "out/images/9.jpg")
    touch(tmp_path, *names)
    sources = find_sources(tmp_path, tmp_path / "out")
    assert sources.names == ("a/1.PNG", "a/2.cr2", "b ü.jpg")
    assert not sources.is_video


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ((), "is empty"),
        (("a.jpg",), r"has 1 photo \(a.jpg\). At least 3"),
        (("a.txt",), "has no photo, but a.txt"),
        (("a.mp4",), "A video is processed by its own name"),
    ],
)
def test_what_cannot_be_processed_is_named(tmp_path, names, said):
    with pytest.raises(CaptureError, match=said):
        find_sources(touch(tmp_path / "p", *names) if names else tmp_path, tmp_path / "out")


def test_a_stage_that_is_done_is_not_done_again_by_a_second_call(tmp_path):
    asked, files = {"longest_side": "1600"}, {"a.jpg": 3}
    open_workspace(tmp_path / "out", asked, files).stage("photos", lambda: [1])
    again = open_workspace(tmp_path / "out", asked, files)
    assert again.stage("photos", lambda: pytest.fail("done twice")) == [1]


def test_other_photos_or_options_are_listed_together(tmp_path):
    open_workspace(tmp_path / "out", {"longest_side": "1600"}, {"a": 1, "b": 1})
    with pytest.raises(ConfigError) as caught:
        open_workspace(tmp_path / "out", {"longest_side": "800"}, {"a": 2, "c": 1})
    for said in ("--longest-side was 1600 and is 800", "new (c)", "gone (b)", "changed (a)"):
        assert said in str(caught.value)


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    touch(tmp_path, "thesis.doc")
    with pytest.raises(ConfigError, match=r"holds something else: thesis\.doc"):
        open_workspace(tmp_path, {}, {})
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.doc"]


def test_all_wrong_numbers_are_told_at_once():
    with pytest.raises(ConfigError, match=r"--longest-side is 5.*--threads is -1"):
        Request(Path("p"), Path("o"), longest_side=5, threads=-1).check()
