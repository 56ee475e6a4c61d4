"""Masks for photos: no features where one is black, and at what price theirs is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.images import write_image
from desplat_ns.data.photo_files import photo_names
from desplat_ns.process import preparation
from desplat_ns.process.photos import Photo
from desplat_ns.process.preparation import prepare_masks
from tests.helpers.yard import EDGE, Features, features_of, places_of, write_mask_of_the_mark

ROUNDED = 1.0
"""Pixels: pycolmap takes the mask's value at the pixel nearest to a feature."""


@pytest.mark.slow
def test_there_are_no_features_where_a_mask_is_black_and_all_others_stay(
    marked: Features, tmp_path: Path
):
    mask = write_mask_of_the_mark(tmp_path / "mask.png")
    assert prepare_masks(mask, marked.photos, tmp_path / "masks") == len(marked.photos)
    database = tmp_path / "database.db"
    features_of(marked.photos, marked.copies, database, tmp_path / "masks")
    without, masked = places_of(marked.database), places_of(database)
    for photo in marked.photos:
        before, after = without[photo.copy], masked[photo.copy]
        assert (before[:, 1] > EDGE + ROUNDED).any()
        assert (after[:, 1] < EDGE + ROUNDED).all()
        white = before[before[:, 1] < EDGE - ROUNDED]
        assert len(white) > 0
        np.testing.assert_array_equal(after[after[:, 1] < EDGE - ROUNDED], white)


def photo(name: str) -> Photo:
    return Photo(name, name, name, width=8, height=6)


def test_the_folder_of_masks_is_listed_once_however_many_photos_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    photos = [photo(f"{i}.jpg") for i in range(5)]
    for i in range(5):
        write_image(tmp_path / "masks" / f"{i}.png", np.full((6, 8), i % 2 == 0))
    listed = []

    def counted(folder: Path) -> list[str]:
        listed.append(folder)
        return photo_names(folder)

    monkeypatch.setattr(preparation, "photo_names", counted)
    assert prepare_masks(tmp_path / "masks", photos, tmp_path / "copies") == 5
    assert listed == [tmp_path / "masks"]
