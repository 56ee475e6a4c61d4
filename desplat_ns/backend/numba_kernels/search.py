"""The compiled part of `separation/search.py`: the search for what is in the way.

Each kernel has one parallel part, or two, over bands of rows, one for each worker: such a part
costs some thirty microseconds, as much as a thousand cells. What a band needs of its neighbours'
rows it works out itself, to the same bits. The rest is serial, a few passes over the cells. Planes
and images are flat; `grid` has the cells, whose number is `shape`.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, take
from desplat_ns.backend.numba_kernels.windows import (
    add_colors,
    add_columns,
    add_rows,
    add_windows,
    clear_between,
    close,
    flood,
    rows_of,
    sums_of,
)

GAUSSIANS = 4096
"""That one worker takes at a time."""

RESTART = 16
"""Rows after which the sums over the widest windows are taken anew, so that none depends on where a
band of rows begins."""

_GROWN, _OUTSIDE = np.uint8(2), np.uint8(3)
"""What cells become, as `grow` goes on."""

_ZERO, _ONE, _THREE = np.float32(0), np.float32(1), np.float32(3)
_TINY = np.finfo(np.float32).tiny


@kernel()
def _band(band, bands, rows):
    """The first row of a band and the one behind its last."""
    return np.int64(band * rows // bands), np.int64((band + 1) * rows // bands)


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
    red, green, blue = sums.found, sums.found[width:], sums.found[2 * width :]
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
            mean = np.float32(sums.found[j]) / (down * sums.across[j])
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
        c0, c1 = _band(band, workers, rows)
        if c1 > c0:
            _compare_rows(images, fine_grid, grid, half, least, c0, c1, colors, residual)


@kernel()
def _find_cells_of(means2d, visible, scale, counted, shape, first, end, cell):
    """The cell of each of some Gaussians; one behind the last if its visit does not count."""
    rows, columns, (across, down) = np.float32(shape[0]), np.float32(shape[1]), scale
    nowhere = rows * columns
    for i in range(first, end):
        x, y = np.floor(means2d[2 * i] * across), np.floor(means2d[2 * i + 1] * down)
        inside = visible[i] & (x >= _ZERO) & (x < columns) & (y >= _ZERO) & (y < rows)
        cell[i] = np.int32(y * columns + x if inside else nowhere)
    if counted.size > 0:
        for i in range(first, end):
            if cell[i] < counted.size and not counted[cell[i]]:
                cell[i] = counted.size


@kernel()
def _remember_piece(seen, rule, relative, inside_of, piece, memory):
    """`remember` for some Gaussians."""
    (opacities, usual, times_seen), (views_per_time, least_views, step, _) = seen, rule
    new_usual, new_times, weights, totals = memory
    first, end = piece * GAUSSIANS, min((piece + 1) * GAUSSIANS, usual.size)
    all_values, all_weights = 0.0, 0.0
    for i in range(first, end):
        cell, before = inside_of[i], usual[i]
        inside, off = np.float32(cell < relative.size - 1), relative[cell] - before
        off = (_ONE if off > _ZERO else _ZERO) - (_ONE if off < _ZERO else _ZERO)
        new_usual[i] = before + step * off * inside
        times = times_seen[i] + inside
        certain = times * views_per_time - least_views
        certain = certain if certain > _ZERO else _ZERO
        weight = opacities[i] * (certain if certain < _ONE else _ONE)
        new_times[i], weights[i] = times, weight
        all_values += weight * before
        all_weights += weight
    totals[piece, 0], totals[piece, 1] = all_values, all_weights


@kernel()
def _expect(usual, weights, totals, cell, weight_of_all, half, shape, expected):
    """What is expected in each cell, from the weights of all Gaussians, which are added up in their
    order."""
    rows, columns = shape
    width, plane = columns + 2 * half, rows * columns
    flat, cells = np.zeros((plane + 1, 2), np.float32), np.zeros((rows, 2 * width), np.float32)
    for i in range(usual.size):
        at = np.uint64(cell[i])
        flat[at, 0] += weights[i] * usual[i]
        flat[at, 1] += weights[i]
    for r in range(rows):
        for j in range(columns):
            cells[r, j + half] = flat[r * columns + j, 0]
            cells[r, width + j + half] = flat[r * columns + j, 1]
    all_values = all_weights = 0.0
    for k in range(totals.shape[0]):
        all_values += totals[k, 0]
        all_weights += totals[k, 1]
    typical = np.float32(all_values) / max(np.float32(all_weights), _TINY)
    typical *= weight_of_all
    sums = sums_of(cells, columns, half, 1)
    above, below = sums.found, sums.found[width:]
    for r in range(rows):
        down, row = np.float32(add_windows(cells, r, sums)), expected[r * columns :]
        for j in range(columns):
            n = down * sums.across[j]
            row[j] = np.float32(above[j]) / n + typical
            row[j] /= np.float32(below[j]) / n + weight_of_all


@kernel(parallel=True)
def remember(
    means2d, visible, scale, seen, rule, relative, counted, half, shape, memory, cell, expected,
    counter, workers,
):  # fmt: skip
    """`residuals.excess_residual`, from logarithms of residuals to those that are expected.

    Args:
        means2d: pixels, [N, 2]; `scale` is in cells per pixel, across and down.
        seen: opacities, usual residuals, times seen.
        rule: how many views a time seen is, and views that are too few; the step of a median; the
            weight of what is usual in the whole scene.
        relative: logarithms, and 0 behind the last cell.
        counted: cells that are not masked; empty if none is.
        memory: usual residuals and times seen with this visit, weights in what is expected; totals
            of weighted residuals and of weights, [pieces, 2].
        cell: of each Gaussian.
    """
    for _ in numba.prange(workers):
        piece = take(counter)
        while piece < memory[3].shape[0]:
            first, end = piece * GAUSSIANS, min((piece + 1) * GAUSSIANS, cell.size)
            _find_cells_of(means2d, visible, scale, counted, shape, first, end, cell)
            _remember_piece(seen, rule, relative, cell, piece, memory)
            piece = take(counter)
    _expect(seen[1], memory[2], memory[3], cell, rule[3], half, shape, expected)


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
        of_static, of_photo = sums.found, sums.found[width:]
        for j in range(columns):
            n = down * sums.across[j]
            a, b = np.float32(of_static[j]) / n, np.float32(of_photo[j]) / n
            s[j], p[j], ss[j], pp[j], sp[j] = a, b, a * a, b * b, a * b


@kernel()
def _correlate(down, sums, noise, contrast, alike):
    """`regions.shared_detail` of a row, from sums of s, p, s s, p p, s p."""
    step, t = sums.found.size // 5, sums.found
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
    found = False
    for value in values:
        found |= value > least
    return found


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
            guide[at : at + columns] = cells
        row, kind = excess[r * columns : (r + 1) * columns], kinds[r * columns : (r + 1) * columns]
        kind[:] = 0
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


@kernel()
def grow(kinds, shape, least_cells, inside):
    """`regions.outlier_regions` of cells that stand out weakly, 1, or strongly, 2, as 0 and 1; the
    first row with a region and the one behind the last."""
    rows, columns = shape
    width = columns + 4
    cells = np.zeros((rows + 4) * width, np.uint8)
    spread, stack = np.zeros(cells.size, np.uint8), np.empty(cells.size, np.int32)
    grid = cells.reshape(rows + 4, width)
    around = np.empty(8, np.int64)
    around[0], around[1], around[2], around[3] = -1, 1, -width, width
    around[4], around[5], around[6], around[7] = -width - 1, -width + 1, width - 1, width + 1
    for r in range(rows):
        for j in range(columns):
            grid[r + 2, j + 2] = min(kinds[r * columns + j], 1)
    for r in range(rows):
        for j in range(columns):
            if kinds[r * columns + j] == 2 and grid[r + 2, j + 2] == 1:
                flood(cells, (r + 2) * width + j + 2, _GROWN, around, stack)
    close(cells, spread, shape)
    flood(cells, width + 1, _OUTSIDE, around[:4], stack)
    for k in range(cells.size):
        cells[k] = max(cells[k], 1)  # what is 0 yet cannot be reached from outside
    top, end = rows, 0
    for r in range(rows):
        for j in range(columns):
            at = (r + 2) * width + j + 2
            if cells[at] == 1 and flood(cells, at, _GROWN, around, stack) < least_cells:
                flood(cells, at, _OUTSIDE, around, stack)
            inside[r * columns + j] = cells[at] == 2
            if cells[at] == 2:
                top, end = min(top, r), r + 1
    return top, end


@kernel()
def _prepare(guide, shape, half, first, end, products):
    """Rows of what is averaged over windows: colours, what is inside, and products."""
    columns, planes = shape[1], guide.size // 4
    width = columns + 2 * half
    for i in range(first, end):
        clear_between(products[i], columns, half)
        r, row = guide[i * columns :], products[i, half:]
        g, b, m = r[planes:], r[2 * planes :], r[3 * planes :]
        for k, one in enumerate((r, g, b, m)):
            row[k * width : k * width + columns] = one[:columns]
        pairs = ((r, m), (g, m), (b, m), (r, r), (g, g), (b, b), (g, b), (r, b), (r, g))
        for k, (one, other) in enumerate(pairs):
            product = row[(k + 4) * width :]
            for j in range(columns):
                product[j] = one[j] * other[j]


@kernel()
def _fit(down, sums, noise, fits):
    """A row of `regions.along_edges`: slopes by the three colours, and offsets."""
    columns, half, t = sums.across.size, sums.half, sums.found
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
def _outline_rows(guide, shape, half, noise, c0, c1, regions):
    """`regions.along_edges` for rows from c0 to before c1; `guide` are colours and what is inside,
    four planes."""
    rows, columns = shape
    plane, width = rows * columns, columns + 2 * half
    products, fits = np.empty((rows, 13 * width)), np.empty((rows, 4 * width))
    first, end = max(c0 - half, 0), min(c1 + half, rows)
    begin = max(first - first % RESTART - half, 0)
    _prepare(guide, shape, half, begin, min(end + half, rows), products)
    sums = sums_of(products, columns, half, RESTART)
    for r in range(first, end):
        down = np.float32(add_windows(products, r, sums))
        clear_between(fits[r], columns, half)
        _fit(down, sums, noise, fits[r])
    sums = sums_of(fits, columns, half, 1)
    x, y, z = sums.found, sums.found[width:], sums.found[2 * width :]
    offset = sums.found[3 * width :]
    for r in range(c0, c1):
        down, red = np.float32(add_windows(fits, r, sums)), guide[r * columns :]
        green, blue, row = red[plane:], red[2 * plane :], regions[r * columns :]
        for j in range(columns):
            total = x[j] * red[j] + y[j] * green[j] + z[j] * blue[j] + offset[j]
            row[j] = total > 0.5 * np.float64(down * sums.across[j])


@kernel(parallel=True)
def find_cells(colors, fine, excess, grid, halves, outline, rules, least_cells, regions, workers):
    """`regions.find_regions`.

    Args:
        colors: of both images in fine cells, as `compare_images` gives them.
        fine: rows and columns of those.
        excess: of cells, as `regions`.
        halves: of the windows for smoothing and for detail.
        outline: half the window, and the variance that is no edge.
        rules: weak and strong excess, shared detail, noise of detail, most contrast.
        least_cells: that a region has.
    """
    shape = (grid.top.size, grid.left.size)
    rows, (half, noise) = shape[0], outline
    kinds, guide = np.empty(regions.size, np.uint8), np.empty(4 * regions.size)
    for band in numba.prange(workers):
        c0, c1 = _band(band, workers, rows)
        _judge_rows(colors, fine, excess, grid, halves, rules, c0, c1, kinds, guide)
    top, end = grow(kinds, shape, least_cells, guide[3 * regions.size :])
    regions[:] = False
    if top >= end:
        return
    top, end = max(top - 2 * half, 0), min(end + 2 * half, rows)
    for band in numba.prange(workers):
        c0, c1 = _band(band, workers, end - top)
        _outline_rows(guide, shape, half, noise, top + c0, top + c1, regions)
