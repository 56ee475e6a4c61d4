from __future__ import annotations

import numpy as np
import pytest

from lab.sheet import BAR, GAP, PAPER, sheet


def test_pictures_stand_in_their_row_and_column_and_long_titles_end_with_it():
    pictures = np.random.default_rng(0).integers(0, 256, (2, 2, 40, 80, 3), np.uint8)
    rows = [(f"view {i}", list(pictures[i])) for i in range(2)]
    drawn = sheet(rows, ["a very long title indeed, far too long", ""])
    for i in range(2):
        for j in range(2):
            y, x = GAP + BAR + i * (40 + BAR), GAP + j * (80 + GAP)
            np.testing.assert_array_equal(drawn[y : y + 40, x : x + 80], pictures[i, j])
    assert (drawn[: GAP + BAR, :86] != PAPER).any()
    assert (drawn[: GAP + BAR, 92:] == PAPER).all()


def test_rows_that_do_not_fit_the_titles_are_an_error():
    with pytest.raises(ValueError):
        sheet([("", [np.zeros((2, 2, 3), np.uint8)])], ["photo", "static"])
