"""What may be processed: photos of a folder, one video, numbers in their range."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.process.request import Request, find_sources


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


def test_photos_in_folders_are_found_and_hidden_ones_and_the_output_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = ("b ü.jpg", "a/1.PNG", "note.txt", "a/2.png", ".x.jpg", "out/images/9.jpg")
    touch(tmp_path, *names, ".thumbnails/0.jpg", "trip/.picasaoriginals/0.jpg")
    sources = find_sources(tmp_path, tmp_path / "out")
    assert sources.names == ("a/1.PNG", "a/2.png", "b ü.jpg")
    assert not sources.is_video
    assert "1 passed over: 1 .txt" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("names", [(), ("a.jpg",), ("a.txt",), ("a.mp4",)])
def test_what_cannot_be_processed_is_named(tmp_path: Path, names: tuple[str, ...]):
    folder = touch(tmp_path / "p", *names) if names else tmp_path
    with pytest.raises(CaptureError, match=names[0] if names else str(tmp_path)):
        find_sources(folder, tmp_path / "out")


@pytest.mark.parametrize("output", ["photos", "."])
def test_a_capture_is_not_made_in_or_around_the_folder_of_its_photos(tmp_path: Path, output: str):
    photos = touch(tmp_path / "photos", *(f"{i}.jpg" for i in range(3)))
    with pytest.raises(CaptureError):
        find_sources(photos, tmp_path / output)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_name_that_is_no_text_is_named(tmp_path: Path):
    """As unpacked from an archive of an old system, whose umlauts have one byte."""
    touch(tmp_path, *(f"{i}.jpg" for i in range(3)))
    os.rename(tmp_path / "1.jpg", os.fsencode(tmp_path) + b"/gr\xfcn.jpg")
    os.rename(tmp_path / "2.jpg", tmp_path / "a\nb.jpg")
    with pytest.raises(CaptureError, match=r"(?s)^2 names.*gr\\xfcn\.jpg") as caught:
        find_sources(tmp_path, tmp_path / "out")
    str(caught.value).encode()  # it can be printed


@pytest.mark.parametrize("wrong", [{"longest_side": 5}, {"frames": 2}, {"threads": -1}])
def test_a_number_that_cannot_be_is_named(tmp_path: Path, wrong: dict[str, int]):
    (name,) = wrong
    with pytest.raises(ConfigError, match=f"--{name.replace('_', '-')}"):
        Request(tmp_path, tmp_path / "o", **wrong).main()  # pyright: ignore[reportArgumentType]
