"""Copies of photos and what is known of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from desplat_ns.process.photos import prepare_photos

EXIF, FOCAL_35MM = 0x8769, 0xA405
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
