"""Copies of photos and what is known of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from desplat_ns.process import photos as module
from desplat_ns.process.photos import Photo, prepare_photos, write_jpeg

EXIF, FOCAL_35MM, ORIENTATION = 0x8769, 0xA405, 0x0112
FILM = 36.0, 24.0
"""Millimetres of a picture on 35 mm film, which the focal length of EXIF is for."""


@pytest.mark.parametrize(("width", "height"), [(300, 200), (320, 240), (150, 200)])
@pytest.mark.parametrize("longest_side", [1600, 100])
def test_a_focal_length_by_exif_sees_the_same_across_as_on_film(
    width: int, height: int, longest_side: int, tmp_path: Path
):
    """From corner to corner, whatever the shape of the photo and however it is reduced."""
    tags = PIL.Image.Exif()
    tags.get_ifd(EXIF)[FOCAL_35MM] = 28
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    PIL.Image.fromarray(noise).save(tmp_path / "a.jpg", exif=tags)
    (photo,) = prepare_photos(
        tmp_path, ["a.jpg"], tmp_path / "copies", longest_side, 1, lambda done: None
    )
    across = np.hypot(photo.width, photo.height) / photo.focal
    # the focal length is rounded to hundredths of a pixel, the film's diagonal to 1e-4 mm
    rounded = 0.005 / photo.focal + 1e-4 / np.hypot(*FILM)
    assert across == pytest.approx(np.hypot(*FILM) / 28, rel=rounded)


def test_a_photo_without_exif_has_no_focal_length(photo_writer, tmp_path: Path):
    photo_writer(tmp_path / "a.jpg", 60, 40)
    (photo,) = prepare_photos(tmp_path, ["a.jpg"], tmp_path / "c", 1600, 1, lambda done: None)
    assert photo.focal == 0.0


def prepared(folder: Path, *names: str) -> list[Photo]:
    """Photos of `folder` with copies in `folder`/copies."""
    return prepare_photos(folder, names, folder / "copies", 1600, 2, lambda done: None)


def test_a_call_that_was_killed_twice_copies_each_photo_once(
    photo_writer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A kill cuts off the record's last line; the next call's lines must not be lost with it."""
    names = [f"{letter}.png" for letter in "abcd"]
    for seed, name in enumerate(names):
        photo_writer(tmp_path / name, 60, 40, seed=seed)
    whole = prepared(tmp_path, *names)
    record = tmp_path / "copies" / "seen.jsonl"
    content = record.read_bytes()
    place = content.index(b'"c.png"')
    record.write_bytes(content[: place + 3])  # two lines, and the beginning of a third
    written: list[str] = []

    def noted(path: Path, pixels: np.ndarray) -> None:
        written.append(path.name)
        write_jpeg(path, pixels)

    monkeypatch.setattr(module, "write_jpeg", noted)
    assert prepared(tmp_path, *names) == whole
    assert sorted(written) == ["00003.jpg", "00004.jpg"]
    assert prepared(tmp_path, *names) == whole
    assert len(written) == 2


def test_a_photo_that_was_taken_upright_is_copied_upright(tmp_path: Path):
    """EXIF's 6: what is on the right of the pixels on disk is at the bottom of the photo."""
    tags = PIL.Image.Exif()
    tags[ORIENTATION] = 6
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, 30:] = 255
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png", exif=tags)
    (photo,) = prepared(tmp_path, "a.png")
    assert (photo.width, photo.height) == (40, 60)
    with PIL.Image.open(tmp_path / "copies" / photo.copy) as copy:
        upper, lower = np.split(np.asarray(copy), 2)
    assert upper[:22].max() < 10 and lower[8:].min() > 245  # a block of 8 lies on the edge


@pytest.mark.parametrize(
    ("pixels", "expected"),
    [
        (np.full((16, 16), 200, np.uint8), (200, 200, 200)),
        (np.full((16, 16), 200 * 257, np.uint16), (200, 200, 200)),
        (np.full((16, 16, 4), (200, 100, 50, 255), np.uint8), (200, 100, 50)),
    ],
    ids=["grey", "16 bit", "alpha"],
)
def test_photos_of_every_kind_become_copies_of_8_bit_colours(pixels, expected, tmp_path: Path):
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    (photo,) = prepared(tmp_path, "a.png")
    with PIL.Image.open(tmp_path / "copies" / photo.copy) as copy:
        assert copy.mode == "RGB"
        colors = np.asarray(copy).reshape(-1, 3).astype(int)
    assert np.abs(colors - expected).max() <= 2  # YCbCr is rounded, and back


def test_a_picture_that_is_there_twice_is_used_once(photo_writer, tmp_path: Path):
    for name in ("a.png", "b.png"):
        photo_writer(tmp_path / name, 60, 40, seed=0)
    photo_writer(tmp_path / "c.png", 60, 40, seed=1)
    problems = [photo.problem for photo in prepared(tmp_path, "a.png", "b.png", "c.png")]
    assert problems == ["", "the same picture as a.png", ""]
