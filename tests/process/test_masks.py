"""No features where a mask is black."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from desplat_ns.process.masks import prepare_masks
from tests.helpers.yard import EDGE, Found, features_of, places_of, write_mask_of_the_mark

ROUNDED = 1.0
"""Pixels: pycolmap takes the mask's value at the pixel nearest to a feature."""


def test_there_are_no_features_where_a_mask_is_black_and_all_others_stay(
    marked: Found, tmp_path: Path
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
