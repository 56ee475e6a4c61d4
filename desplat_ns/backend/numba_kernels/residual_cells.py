"""The compiled `residuals.local_residual`: both images in cells, and how far they are apart.

Work is parallel over bands of rows of cells, one for each worker. What a band needs of its
neighbours' rows it works out itself, to the same bits.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel
from desplat_ns.backend.numba_kernels.windows import (
    add_colors,
    add_columns,
    add_rows,
    add_windows,
    band_of,
    clear_between,
    rows_of,
    sums_of,
)


@kernel()
def _pool(image, grid, first, end, colors):
    """Rows of cells of an image, [H, W, 3], in three planes."""
    rows, columns = grid.top.size, grid.left.size
    length = 3 * (int(grid.left[columns - 1]) + grid.along.shape[0])
    line = np.empty(length, np.float32)
    for r in range(first, end):
        add_rows(image, length, grid, r, line)
        add_colors(line, grid, colors, r * columns, rows * columns)


@kernel()
def _differ(colors, rows, half, first, end, largest):
    """Rows of the largest of the three colours' differences, each averaged over a window."""
    plane = colors[0].size // 3
    columns = plane // rows
    width = columns + 2 * half
    signed = np.empty((rows, 3 * width), np.float32)
    for r in range(max(first - half, 0), min(end + half, rows)):
        clear_between(signed[r], columns, half)
        for k in range(3):
            at = k * plane + r * columns
            a, b, row = colors[0][at:], colors[1][at:], signed[r, k * width + half :]
            for j in range(columns):
                row[j] = a[j] - b[j]
    sums = sums_of(signed, columns, half, 1)
    red, green, blue = sums.totals, sums.totals[width:], sums.totals[2 * width :]
    for r in range(first, end):
        down, row = np.float32(add_windows(signed, r, sums)), largest[r * columns :]
        for j in range(columns):
            n = down * sums.across[j]
            a, b = abs(np.float32(red[j]) / n), abs(np.float32(green[j]) / n)
            a, b = a if a > b else b, abs(np.float32(blue[j]) / n)
            row[j] = a if a > b else b


@kernel()
def _compare_rows(images, fine_grid, grid, half, least, c0, c1, colors, residual):
    """`compare_images` for rows of cells from c0 to before c1."""
    rows, columns = grid.top.size, grid.left.size
    fine_rows, width = fine_grid.top.size, fine_grid.left.size
    e0, e1 = max(c0 - half, 0), min(c1 + half, rows)
    f0, f1 = rows_of(grid, e0, e1)
    for k in range(2):
        _pool(images[k], fine_grid, max(f0 - half, 0), min(f1 + half, fine_rows), colors[k])
    largest, line = np.empty(fine_rows * width, np.float32), np.empty(width, np.float32)
    _differ(colors, fine_rows, half, f0, f1, largest)
    cells = np.zeros((rows, columns + 2 * half), np.float32)
    for r in range(e0, e1):
        add_rows(largest, width, grid, r, line)
        add_columns(line, grid, cells[r, half : half + columns])
    sums = sums_of(cells, columns, half, 1)
    for r in range(c0, c1):
        down, row = np.float32(add_windows(cells, r, sums)), residual[r * columns :]
        for j in range(columns):
            mean = np.float32(sums.totals[j]) / (down * sums.across[j])
            row[j] = mean if mean > least else least


@kernel(parallel=True)
def compare_images(images, fine_grid, grid, half, least, colors, residual, workers):
    """Both images in fine cells, and `residuals.local_residual`.

    Args:
        images: the static scene and the photo, [H, W, 3].
        fine_grid: of pixels; `grid` is of fine cells.
        half: of the window.
        least: residual.
        colors: of both in fine cells, [3, fine_rows, fine_columns]. What two bands need is written
            by both, to the same bits.
    """
    rows = grid.top.size
    for band in numba.prange(workers):
        c0, c1 = band_of(band, workers, rows)
        if c1 > c0:
            _compare_rows(images, fine_grid, grid, half, least, c0, c1, colors, residual)
