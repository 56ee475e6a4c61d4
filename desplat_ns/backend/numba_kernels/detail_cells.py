"""The compiled `regions.shared_detail`, and which cells stand out with detail of their own."""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel
from desplat_ns.backend.numba_kernels.windows import (
    add_columns,
    add_rows,
    add_windows,
    band_of,
    clear_between,
    rows_of,
    sums_of,
)

_ZERO, _THREE = np.float32(0), np.float32(3)


@kernel()
def _smooth(colors, half, first, end, grey, sums, moments, wide):
    """Rows of the grey of both images, smoothed, and of its products."""
    columns, rows, width = sums.across.size, grey.shape[0], sums.across.size + 2 * half
    plane = rows * columns
    for r in range(max(first - half, 0), min(end + half, rows)):
        clear_between(grey[r], columns, half)
        for k in range(2):
            image, row = colors[k][r * columns :], grey[r, k * width + half :]
            green, blue = image[plane:], image[2 * plane :]
            for j in range(columns):
                row[j] = (image[j] + green[j] + blue[j]) / _THREE
    step = columns + 2 * wide
    for r in range(first, end):
        down, row = np.float32(add_windows(grey, r, sums)), moments[r, wide:]
        clear_between(moments[r], columns, wide)
        s, p, ss, pp, sp = row, row[step:], row[2 * step :], row[3 * step :], row[4 * step :]
        of_static, of_photo = sums.totals, sums.totals[width:]
        for j in range(columns):
            n = down * sums.across[j]
            a, b = np.float32(of_static[j]) / n, np.float32(of_photo[j]) / n
            s[j], p[j], ss[j], pp[j], sp[j] = a, b, a * a, b * b, a * b


@kernel()
def _correlate(down, sums, noise, contrast, alike):
    """`regions.shared_detail` of a row, from sums of s, p, s s, p p, s p."""
    step, t = sums.totals.size // 5, sums.totals
    t1, t2, t3, t4 = t[step:], t[2 * step :], t[3 * step :], t[4 * step :]
    for j in range(alike.size):
        n = down * sums.across[j]
        s, p = np.float32(t[j]) / n, np.float32(t1[j]) / n
        ss, pp = np.float32(t2[j]) / n - s * s, np.float32(t3[j]) / n - p * p
        of_static, of_photo = max(ss, _ZERO) + noise, max(pp, _ZERO) + noise
        common = np.float32(t4[j]) / n - s * p
        value = common / np.sqrt(of_static * of_photo)
        alike[j] = _ZERO if common / of_static > contrast else value


@kernel()
def _is_any_above(values, least):
    is_above = False
    for value in values:
        is_above |= value > least
    return is_above


@kernel()
def _judge_rows(colors, fine, excess, grid, halves, rules, c0, c1, kinds, guide):
    """Cells of rows from c0 to before c1 that stand out weakly, 1, or strongly, 2, with detail of
    their own; and the photo's colours in all of them."""
    rows, columns, (fine_rows, width), (half, wide) = grid.top.size, grid.left.size, fine, halves
    weak, strong, shared, noise, contrast = rules
    plane = fine_rows * width
    grey = np.empty((fine_rows, 2 * (width + 2 * half)), np.float32)
    moments = np.empty((fine_rows, 5 * (width + 2 * wide)), np.float32)
    smooth, detail = sums_of(grey, width, half, 1), sums_of(moments, width, wide, 1)
    alike, line = np.empty(plane, np.float32), np.empty(width, np.float32)
    cells, smooth_to, alike_to = np.empty(columns, np.float32), 0, 0
    for r in range(c0, c1):
        for k in range(3):
            add_rows(colors[1][k * plane : (k + 1) * plane], width, grid, r, line)
            add_columns(line, grid, cells)
            at = (k * rows + r) * columns
            for j in range(columns):
                guide[at + j] = cells[j]
        row, kind = excess[r * columns : (r + 1) * columns], kinds[r * columns : (r + 1) * columns]
        for j in range(columns):
            kind[j] = 0
        if not _is_any_above(row, weak):
            continue
        first, end = rows_of(grid, r, r + 1)
        s0, s1 = max(first - wide, smooth_to, 0), min(end + wide, fine_rows)
        _smooth(colors, half, s0, s1, grey, smooth, moments, wide)
        for f in range(max(first, alike_to), end):
            down = np.float32(add_windows(moments, f, detail))
            _correlate(down, detail, noise, contrast, alike[f * width : (f + 1) * width])
        smooth_to, alike_to = s1, end
        add_rows(alike, width, grid, r, line)
        add_columns(line, grid, cells)
        for j in range(columns):
            if row[j] > weak and cells[j] <= shared:
                kind[j] = 2 if row[j] > strong else 1


@kernel(parallel=True)
def judge_cells(colors, fine, excess, grid, halves, rules, kinds, guide, workers):
    """Cells that stand out, as `regions.find_regions` has them before they are connected.

    Args:
        colors: of both images in fine cells, as `compare_images` gives them.
        fine: rows and columns of those.
        excess: of cells.
        halves: of the windows for smoothing and for detail.
        rules: weak and strong excess, shared detail, noise of detail, most contrast.
        kinds: of cells: 1 where they stand out weakly, 2 strongly, else 0.
        guide: the photo's colours in cells, three planes.
    """
    for band in numba.prange(workers):
        c0, c1 = band_of(band, workers, grid.top.size)
        _judge_rows(colors, fine, excess, grid, halves, rules, c0, c1, kinds, guide)
