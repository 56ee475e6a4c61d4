from __future__ import annotations

import numpy as np
import pytest

from lab.sheet import BAR, GAP, PAPER, sheet


def test_pictures_stand_in_their_row_and_column_unchanged():
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 256, (2, 3, 40, 60, 3), np.uint8)
    rows = [(f"view {i}", list(pictures[i])) for i in range(2)]
    drawn = sheet(rows, ["photo", "static", "mask"])
    assert drawn.shape == (GAP + BAR + 2 * (40 + BAR), GAP + 3 * (60 + GAP), 3)
    for i in range(2):
        for j in range(3):
            y, x = GAP + BAR + i * (40 + BAR), GAP + j * (60 + GAP)
            np.testing.assert_array_equal(drawn[y : y + 40, x : x + 60], pictures[i, j])


def test_labels_are_written_and_long_ones_stay_in_their_column():
    blank = np.full((30, 80, 3), 255, np.uint8)
    drawn = sheet([("", [blank, blank])], ["a very long title indeed, far too long", ""])
    assert (drawn[: GAP + BAR, :86] != PAPER).any()
    assert (drawn[: GAP + BAR, 92:] == PAPER).all()
    heading = sheet([("", [blank, blank])], ["", ""], heading="Demo")
    assert heading.shape[0] == drawn.shape[0] + BAR


def test_pictures_of_other_sizes_are_brought_to_the_first():
    small = np.zeros((10, 10, 3), np.uint8)
    drawn = sheet([("", [np.zeros((20, 20, 3), np.uint8), small + 7])], ["", ""])
    assert (drawn[GAP + BAR : GAP + BAR + 20, 2 * GAP + 20 : 2 * GAP + 40] == 7).all()


@pytest.mark.parametrize("rows", [[], [("", [np.zeros((2, 2, 3), np.uint8)])]])
def test_rows_that_do_not_fit_the_titles_are_an_error(rows):
    with pytest.raises(ValueError, match="give each row one picture for each title"):
        sheet(rows, ["photo", "static"])
