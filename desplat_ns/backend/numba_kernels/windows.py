"""Parts of the compiled search (`separation/search.py`): bands of rows, means over cells, and sums
over windows.

A parallel part costs some thirty microseconds, as much as a thousand cells: so a kernel has one,
over bands of rows, one for each worker. Planes and images are flat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel


class Grid(NamedTuple):
    """Which pixels cells are the means of: the first row of pixels of each row of cells, weights of
    this one and of those that follow, [pixels, cells]; and the same of columns."""

    top: np.ndarray
    down: np.ndarray
    left: np.ndarray
    along: np.ndarray


@kernel()
def band_of(band, bands, rows):
    """The first row of a band and the one behind its last."""
    return np.int64(band * rows // bands), np.int64((band + 1) * rows // bands)


@kernel()
def rows_of(grid, first, end):
    """From the first to behind the last row of an image that make up rows of cells."""
    return int(grid.top[first]), int(grid.top[end - 1]) + grid.down.shape[0]


@kernel()
def _clear(out, count):
    """As `out[:count] = 0`, which takes a second to compile."""
    for j in range(count):
        out[j] = 0


@kernel()
def add_rows(image, length, grid, r, line):
    """A row of cells that is as long as a row of the image, `length` numbers."""
    _clear(line, length)
    for k in range(grid.down.shape[0]):
        weight, row = grid.down[k, r], image[(int(grid.top[r]) + k) * length :]
        if weight > 0:
            for j in range(length):
                line[j] += weight * row[j]


@kernel()
def add_columns(line, grid, out):
    """Cells of a row of one channel."""
    _clear(out, out.size)
    for k in range(grid.along.shape[0]):
        for c in range(np.uint64(out.size)):
            out[c] += grid.along[k, c] * line[grid.left[c] + np.uint64(k)]


@kernel()
def add_colors(line, grid, out, at, plane):
    """Cells of a row of three channels that lie side by side, as a row of each of three planes."""
    green, blue, channels = np.uint64(1), np.uint64(2), np.uint64(3)
    for c in range(np.uint64(grid.left.size)):
        i, to = channels * grid.left[c], np.uint64(at) + c
        r = g = b = np.float32(0)
        for k in range(grid.along.shape[0]):
            w = grid.along[k, c]
            r, g, b = r + w * line[i], g + w * line[i + green], b + w * line[i + blue]
            i += channels
        out[to], out[to + np.uint64(plane)], out[to + np.uint64(2 * plane)] = r, g, b


class Sums(NamedTuple):
    """What is kept from row to row of the sums over windows of 2 half + 1 cells a side.

    Cells are in rows of several planes, one behind the other, each between `half` zeros.
    """

    half: int
    restart: int
    """Rows after which sums of columns are taken anew, not from those of the row above."""
    below: np.ndarray
    """Sums of columns of cells, as long as a row."""
    last: np.ndarray
    """Number of their row, [1]."""
    totals: np.ndarray
    """Sums over the windows of a row, as far as they are in the image; that around a cell lies
    `half` before it."""
    across: np.ndarray
    """Columns in the windows of a row of one plane."""


@kernel()
def sums_of(cells, columns, half, restart):
    """None so far; `columns` are those of a plane."""
    length, across = cells.shape[1], np.empty(columns, np.float32)
    for j in range(columns):
        across[j] = min(j + half, columns - 1) - max(j - half, 0) + 1
    return Sums(half, restart, np.empty(length), np.full(1, -2), np.empty(length), across)


@kernel()
def _add(row, sign, below):
    for j in range(below.size):
        below[j] += sign * row[j]


@kernel()
def add_windows(cells, r, sums):
    """Find the sums of a row, in float64; how many rows its windows have."""
    rows, half, below, total = cells.shape[0], sums.half, sums.below, sums.totals
    first = r - 1
    if r % sums.restart == 0 or sums.last[0] != first:
        first = r - r % sums.restart
        _clear(below, below.size)
        for i in range(max(first - half, 0), min(first + half + 1, rows)):
            _add(cells[i], 1.0, below)
    for i in range(first + 1, r + 1):
        if i + half < rows:
            _add(cells[i + half], 1.0, below)
        if i > half:
            _add(cells[i - half - 1], -1.0, below)
    sums.last[0], end = r, below.size - 2 * half
    for j in range(end):
        total[j] = below[half + j]
    for k in range(1, half + 1):
        a, b = below[half - k :], below[half + k :]
        for j in range(end):
            total[j] += a[j] + b[j]
    return min(r + half + 1, rows) - max(r - half, 0)


@kernel()
def clear_between(row, columns, half):
    """Zeros before and behind each plane of a row of cells."""
    for first in range(0, row.size, columns + 2 * half):
        for j in range(first, first + half):
            row[j] = row[j + half + columns] = 0
