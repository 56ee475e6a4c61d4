"""What may be processed: photos of a folder, one video, numbers in their range."""

import os
import sys
from pathlib import Path

import pytest

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.process.request import find_photos
from tests.helpers.files import touch


def test_photos_in_folders_are_found_and_hidden_ones_and_the_output_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = ("b ü.jpg", "a/1.PNG", "note.txt", "a/2.png", ".x.jpg", "out/images/9.jpg")
    touch(tmp_path, *names, ".thumbnails/0.jpg", "trip/.picasaoriginals/0.jpg")
    assert find_photos(tmp_path, tmp_path / "out") == ["a/1.PNG", "a/2.png", "b ü.jpg"]
    assert "1 passed over: 1 .txt" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("names", [(), ("a.jpg",), ("a.txt",), ("a.mp4",)])
def test_what_cannot_be_processed_is_named(tmp_path: Path, names: tuple[str, ...]):
    folder = touch(tmp_path / "p", *names) if names else tmp_path
    with pytest.raises(CaptureError, match=names[0] if names else str(tmp_path)):
        find_photos(folder, tmp_path / "out")


@pytest.mark.parametrize("output", ["photos", "."])
def test_a_capture_is_not_made_in_or_around_the_folder_of_its_photos(tmp_path: Path, output: str):
    photos = touch(tmp_path / "photos", *(f"{i}.jpg" for i in range(3)))
    with pytest.raises(CaptureError):
        find_photos(photos, tmp_path / output)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_name_that_is_no_text_is_named(tmp_path: Path):
    """As unpacked from an archive of an old system, whose umlauts have one byte."""
    touch(tmp_path, *(f"{i}.jpg" for i in range(3)))
    os.rename(tmp_path / "1.jpg", os.fsencode(tmp_path) + b"/gr\xfcn.jpg")
    os.rename(tmp_path / "2.jpg", tmp_path / "a\nb.jpg")
    with pytest.raises(CaptureError, match=r"(?s)^2 names.*gr\\xfcn\.jpg") as caught:
        find_photos(tmp_path, tmp_path / "out")
    str(caught.value).encode()  # it can be printed


@pytest.mark.parametrize("masks", ["masks", "day 1/Masks", "sky_masks/left"])
def test_masks_that_lie_among_the_photos_are_not_taken_for_photos(
    tmp_path: Path, masks: str, capsys: pytest.CaptureFixture[str]
):
    names = ("a.jpg", "b.jpg", "c.jpg", "carnival masks/2.jpg", "maskenball/a.jpg")
    touch(tmp_path, *names, f"{masks}/a.png", f"{masks}/b.jpg.png")
    assert find_photos(tmp_path, tmp_path / "out") == sorted(names)
    said = capsys.readouterr().out
    assert f"--mask '{tmp_path / masks}'" in said or f"--mask {tmp_path / masks}" in said
    find_photos(tmp_path, tmp_path / "out", tmp_path / masks)
    assert capsys.readouterr().out == ""


def test_masks_beside_the_photos_are_told_and_a_mask_among_them_is_no_photo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    photos = touch(tmp_path / "images", *(f"{i}.jpg" for i in range(3)), "stick.png")
    touch(tmp_path / "masks", "1.png")
    assert len(find_photos(photos, tmp_path / "out")) == 4
    assert "masks" in capsys.readouterr().out
    assert len(find_photos(photos, tmp_path / "out", photos / "stick.png")) == 3
