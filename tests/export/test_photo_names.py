"""Masks have the names that others look for; copies are traced to the photos they were made of."""

from pathlib import Path

import pytest

from desplat_ns.errors import ConfigError
from desplat_ns.export.photos import mask_names, original_of

PHOTOS = ["left/0001.jpg", "left/0002.JPG", "right/0001.jpg"]


def test_colmap_appends_its_ending_and_nerfstudio_replaces_it():
    assert mask_names(PHOTOS, "colmap") == [f"{name}.png" for name in PHOTOS]
    without = ["left/0001.png", "left/0002.png", "right/0001.png"]
    assert mask_names(PHOTOS, "nerfstudio") == without


def test_photos_whose_masks_would_be_one_file_are_named():
    twins = ["a/b.jpg", "a/b.png", "c.jpg"]
    assert len(set(mask_names(twins, "colmap"))) == 3
    with pytest.raises(ConfigError, match=r"the same: a/b\.png\..*--names colmap"):
        mask_names(twins, "nerfstudio")


def test_a_reduced_copy_leads_to_the_photo_in_its_full_size(tmp_path: Path):
    full, copy = tmp_path / "images" / "a" / "b.jpg", tmp_path / "images_4" / "a" / "b.jpg"
    for path in (full, copy):
        path.parent.mkdir(parents=True)
        path.touch()
    images = tmp_path / "images"
    assert original_of(copy, images) == full
    assert original_of(full, images) == full
    full.unlink()
    assert original_of(copy, images) == copy
    other = tmp_path / "images_new" / "b.jpg"
    assert original_of(other, images) == other
