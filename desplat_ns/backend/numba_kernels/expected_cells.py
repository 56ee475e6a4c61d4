"""The compiled `residuals.excess_residual`: what Gaussians remember, and what is expected by it."""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, take
from desplat_ns.backend.numba_kernels.windows import add_windows, sums_of

GAUSSIANS = 4096
"""That one worker takes at a time."""

_ZERO, _ONE = np.float32(0), np.float32(1)
_TINY = np.finfo(np.float32).tiny


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
def _remember_piece(splats, rule, relative, inside_of, piece, memory):
    """`remember` for some Gaussians."""
    (opacities, usual, times_seen), (views_per_time, least_views, step, _) = splats, rule
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
    above, below = sums.totals, sums.totals[width:]
    for r in range(rows):
        down, row = np.float32(add_windows(cells, r, sums)), expected[r * columns :]
        for j in range(columns):
            n = down * sums.across[j]
            row[j] = np.float32(above[j]) / n + typical
            row[j] /= np.float32(below[j]) / n + weight_of_all


@kernel(parallel=True)
def remember(
    means2d, visible, scale, splats, rule, relative, counted, half, shape, memory, cell, expected,
    counter, workers,
):  # fmt: skip
    """`residuals.excess_residual`, from logarithms of residuals to those that are expected.

    Args:
        means2d: pixels, [N, 2]; `scale` is in cells per pixel, across and down.
        splats: opacities, usual residuals, times seen.
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
            _remember_piece(splats, rule, relative, cell, piece, memory)
            piece = take(counter)
    _expect(splats[1], memory[2], memory[3], cell, rule[3], half, shape, expected)
