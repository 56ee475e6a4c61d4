"""The compiled `regions.along_edges`: regions end where the photo's colours change."""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel
from desplat_ns.backend.numba_kernels.windows import (
    add_windows,
    band_of,
    clear_between,
    sums_of,
)

RESTART = 16
"""Rows after which the sums over the widest windows are taken anew, so that none depends on where a
band of rows begins."""


@kernel()
def _prepare(colors, inside, shape, half, first, end, products):
    """Rows of what is averaged over windows: colours, what is inside, and products."""
    columns, planes = shape[1], inside.size
    width = columns + 2 * half
    for i in range(first, end):
        clear_between(products[i], columns, half)
        r, row = colors[i * columns :], products[i, half:]
        g, b, m = r[planes:], r[2 * planes :], inside[i * columns :]
        for k, channel in enumerate((r, g, b, m)):
            copy = row[k * width :]
            for j in range(columns):
                copy[j] = channel[j]
        pairs = ((r, m), (g, m), (b, m), (r, r), (g, g), (b, b), (g, b), (r, b), (r, g))
        for k, (factor, other) in enumerate(pairs):
            product = row[(k + 4) * width :]
            for j in range(columns):
                product[j] = factor[j] * other[j]


@kernel()
def _fit(down, sums, noise, fits):
    """A row of `regions.along_edges`: slopes by the three colours, and offsets."""
    columns, half, t = sums.across.size, sums.half, sums.totals
    w = columns + 2 * half
    t1, t2, t3, t4, t5, t6 = t[w:], t[2 * w :], t[3 * w :], t[4 * w :], t[5 * w :], t[6 * w :]
    t7, t8, t9, t10, t11 = t[7 * w :], t[8 * w :], t[9 * w :], t[10 * w :], t[11 * w :]
    t12, f = t[12 * w :], fits[half:]
    f1, f2, f3 = f[w:], f[2 * w :], f[3 * w :]
    for j in range(columns):
        n = 1 / np.float64(down * sums.across[j])
        r, g, b, m = t[j] * n, t1[j] * n, t2[j] * n, t3[j] * n
        rm, gm, bm = t4[j] * n - r * m, t5[j] * n - g * m, t6[j] * n - b * m
        rr, gg, bb = t7[j] * n - r * r, t8[j] * n - g * g, t9[j] * n - b * b
        rr, gg, bb = max(rr, 0.0) + noise, max(gg, 0.0) + noise, max(bb, 0.0) + noise
        gb, rb, rg = t10[j] * n - g * b, t11[j] * n - r * b, t12[j] * n - r * g
        c00, c01, c02 = gg * bb - gb * gb, gb * rb - rg * bb, rg * gb - gg * rb
        c11, c12, c22 = rr * bb - rb * rb, rg * rb - rr * gb, rr * gg - rg * rg
        scale = 1 / (rr * c00 + rg * c01 + rb * c02)
        x = (c00 * rm + c01 * gm + c02 * bm) * scale
        y = (c01 * rm + c11 * gm + c12 * bm) * scale
        z = (c02 * rm + c12 * gm + c22 * bm) * scale
        f[j], f1[j], f2[j], f3[j] = x, y, z, m - (x * r + y * g + z * b)


@kernel()
def _outline_rows(colors, inside, shape, half, noise, c0, c1, regions):
    """`outline` for rows from c0 to before c1."""
    rows, columns = shape
    plane, width = rows * columns, columns + 2 * half
    products, fits = np.empty((rows, 13 * width)), np.empty((rows, 4 * width))
    first, end = max(c0 - half, 0), min(c1 + half, rows)
    begin = max(first - first % RESTART - half, 0)
    _prepare(colors, inside, shape, half, begin, min(end + half, rows), products)
    sums = sums_of(products, columns, half, RESTART)
    for r in range(first, end):
        down = np.float32(add_windows(products, r, sums))
        clear_between(fits[r], columns, half)
        _fit(down, sums, noise, fits[r])
    sums = sums_of(fits, columns, half, 1)
    x, y, z = sums.totals, sums.totals[width:], sums.totals[2 * width :]
    offset = sums.totals[3 * width :]
    for r in range(c0, c1):
        down, red = np.float32(add_windows(fits, r, sums)), colors[r * columns :]
        green, blue, row = red[plane:], red[2 * plane :], regions[r * columns :]
        for j in range(columns):
            total = x[j] * red[j] + y[j] * green[j] + z[j] * blue[j] + offset[j]
            row[j] = total > 0.5 * np.float64(down * sums.across[j])


@kernel(parallel=True)
def outline(colors, inside, shape, half, noise, rows, regions, workers):
    """`regions.along_edges`.

    Args:
        colors: of the photo in cells, three planes; `shape` is rows and columns.
        inside: 1 in a region, else 0.
        half: of the window; `noise` is the variance that is no edge.
        rows: the first row with a cell in a region, and the one behind the last.
        regions: False everywhere before.
    """
    top, end = max(rows[0] - 2 * half, 0), min(rows[1] + 2 * half, shape[0])
    for band in numba.prange(workers):
        c0, c1 = band_of(band, workers, end - top)
        _outline_rows(colors, inside, shape, half, noise, top + c0, top + c1, regions)
