"""Sums over windows are those of their cells, to the same bits wherever one begins."""

from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.backend.numba_kernels.windows import add_windows, clear_between, sums_of

ROWS, COLUMNS, HALF = 50, 21, 6
WIDTH = COLUMNS + 2 * HALF


def two_planes() -> np.ndarray:
    """Rows of both, with zeros between them."""
    cells = np.random.default_rng(0).random((ROWS, 2 * WIDTH))
    for row in cells:
        clear_between(row, COLUMNS, HALF)
    return cells


def found_in(cells: np.ndarray, first: int, row: int, restart: int) -> tuple[int, np.ndarray]:
    """The rows in a row's windows, and the sums of both planes, where rows are taken from the first
    one on."""
    sums = sums_of(cells, COLUMNS, HALF, restart)
    for r in range(first, row + 1):
        down = add_windows(cells, r, sums)
    return down, sums.totals.reshape(2, WIDTH)[:, :COLUMNS].copy()


@pytest.mark.parametrize("row", [0, 5, 16, 30, 44, 49])
@pytest.mark.parametrize("restart", [1, 16])
def test_sums_are_those_of_the_cells_in_a_window(row, restart):
    """Some 13 x 13 numbers below 1, added and taken away again in float64: 1e3 roundings at most,
    of sums below 13 rows of one column."""
    cells = two_planes()
    down, totals = found_in(cells, 0, row, restart)
    top, end = max(row - HALF, 0), min(row + HALF + 1, ROWS)
    assert down == end - top
    for plane in range(2):
        inner = cells[top:end, plane * WIDTH + HALF : (plane + 1) * WIDTH - HALF]
        for j in range(COLUMNS):
            exact = inner[:, max(j - HALF, 0) : j + HALF + 1].sum()
            assert abs(totals[plane, j] - exact) < 1e3 * np.finfo(float).eps * (2 * HALF + 1)


def test_sums_do_not_depend_on_where_a_band_of_rows_begins():
    cells = two_planes()
    whole = found_in(cells, 0, 31, 16)[1]
    assert not np.array_equal(whole, found_in(cells, 0, 31, 1)[1])  # bits that could differ
    for first in (3, 16, 20, 31):
        assert np.array_equal(found_in(cells, first, 31, 16)[1], whole)
