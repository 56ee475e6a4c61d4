"""The passes over tiles: draw the lists front to back, pull gradients through them back to front.

One worker does one tile at a time, in scratch planes of its own (`pixels` says what is in
them). In the backward pass each (Gaussian, tile) entry writes a row of gradients that no other
entry touches; a last pass sums the rows of each Gaussian. So nothing depends on which worker did
what, and when.
"""

from typing import NamedTuple

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.ellipses import BLOCK, BLOCKS, OPACITY, RECORD, TILE
from desplat_ns.backend.numba_kernels.pixels import (
    AREA,
    COLUMN,
    F0,
    F3,
    LAST,
    NO_SUMS,
    PLANE,
    PLANES,
    WIDTH,
    T,
    U,
    X,
    Y,
    backward,
    blend,
    write_row,
)
from desplat_ns.backend.numba_kernels.runtime import batches, kernel, part, pieces, prefetch

ROWS_CHUNK = 512
"""Gaussians whose rows one worker sums at a time."""

AHEAD = 4
"""Records are asked for so many entries before they are drawn: a list visits them all over memory.
Measured on 75,000 Gaussians: without it the passes took 6% (draw) and 18% (pull) longer."""

ROWS_AHEAD = 12
"""And rows of gradients, before they are summed: without it 85,000 Gaussians took twice as long."""

RUNS = AREA // BLOCK
"""Runs of BLOCK pixels in a tile."""

_CHANNELS = np.uint64(3)


class Frame(NamedTuple):
    """What the forward pass writes, flat float32."""

    colors: np.ndarray
    """[H * W * 3]"""
    depth: np.ndarray
    """[H * W] sum of w z"""
    alpha: np.ndarray
    """[H * W]"""
    transmittance: np.ndarray
    """[tiles * AREA] T_end in the order of tiles, for the backward pass."""
    last: np.ndarray
    """[tiles * AREA] place in the tile's list of the last Gaussian drawn, -1 if none."""


@part()
def _fetch(rows, number, stride):
    """Ask for both ends of a row of `stride` numbers, which may lie in two cache lines."""
    prefetch(rows, number * stride)
    prefetch(rows, number * stride + stride - 1)


@part()
def _row_range(ranges, entry, block):
    """Pixels of a tile, (start, stop), that an entry must look at in one block of columns."""
    entries = ranges.size // (2 * BLOCKS)
    at, first = 2 * block * entries + entry, block * COLUMN
    return first + BLOCK * np.int64(ranges[at]), first + BLOCK * np.int64(ranges[at + entries])


@part()
def _run(run, tile, grid):
    """Image column and row of the first pixel of the run-th BLOCK pixels of a tile.

    They follow one another along the row, and may lie outside the image.
    """
    column = (tile % grid.tiles_x) * TILE + (run // TILE) * BLOCK
    return column, (tile // grid.tiles_x) * TILE + run % TILE


@part()
def _pixels_of(run, tile, grid):
    """Of a run: its first place in the tile, the image's, and how many pixels are in the image.

    Unsigned, for plain loops.
    """
    x, y = _run(run, tile, grid)
    number = min(BLOCK, max(grid.width - x, 0)) if y < grid.height else 0
    return np.uint64(run * BLOCK), np.uint64(y * grid.width + x), np.uint64(number)


@part()
def _open_tile(s, tile, grid):
    """Clear the planes of a tile; pixels outside the image are finished from the start."""
    s[:] = 0
    for run in range(RUNS):
        x, y = _run(run, tile, grid)
        inside = np.uint64(max(grid.width - x, 0)) if y < grid.height else np.uint64(0)
        center_x, center_y = np.float32(x) + np.float32(0.5), np.float32(y) + np.float32(0.5)
        for k in range(np.uint64(BLOCK)):
            p = np.uint64(run * BLOCK) + k
            s[X + p], s[Y + p] = center_x + np.float32(k), center_y
            s[T + p] = np.float32(1) if k < inside else np.float32(-1)
            s[LAST + p] = np.float32(-1)


@part()
def _all_finished(s):
    open_pixels = 0
    for p in range(np.uint64(AREA)):
        open_pixels += s[T + p] > 0
    return open_pixels == 0


@part()
def _draw_tile(s, tile, lists, limits):
    """Draw the list of a tile front to back until every pixel is finished."""
    records, ranks, row_ranges = lists.records, lists.ranks, lists.row_ranges
    first = lists.first_entry[tile]
    number = lists.first_entry[tile + 1] - first
    for place in range(number):
        base = ranks[first + place] * RECORD
        _fetch(records, ranks[first + min(place + AHEAD, number - 1)], RECORD)
        for block in range(BLOCKS):
            start, stop = _row_range(row_ranges, first + place, block)
            if start < stop:
                blend(s, records, base, np.float32(place), start, stop, limits)
        if place % 16 == 15 and _all_finished(s):
            return


@part()
def _write_tile(s, tile, grid, frame):
    """Copy the planes of a tile into the frame."""
    colors, depth, alpha, transmittance, last = frame
    first = np.uint64(tile * AREA)
    for p in range(np.uint64(AREA)):
        transmittance[first + p] = abs(s[T + p])
        last[first + p] = s[LAST + p]
    for run in range(RUNS):
        p, at, number = _pixels_of(run, tile, grid)
        for k in range(number):
            alpha[at + k] = np.float32(1) - abs(s[T + p + k])
            depth[at + k] = s[F3 + p + k]
        for channel in range(_CHANNELS):
            plane, to = F0 + np.uint64(PLANE) * channel + p, at * _CHANNELS + channel
            for k in range(number):
                colors[to + k * _CHANNELS] = s[plane + k]


@part()
def _write_empty_tile(tile, grid, frame):
    """What is seen where nothing is. The backward pass does not come here."""
    colors, depth, alpha = frame.colors, frame.depth, frame.alpha
    x, y = _run(0, tile, grid)
    for row in range(y, min(y + TILE, grid.height)):
        first, end = row * grid.width + x, row * grid.width + min(x + TILE, grid.width)
        colors[3 * first : 3 * end] = 0
        alpha[first:end] = depth[first:end] = 0


@part()
def _is_empty(tile, lists):
    return lists.first_entry[tile] == lists.first_entry[tile + 1]


@kernel(parallel=True)
def draw_frame(lists, grid, frame, limits, counter, workers):
    """Forward pass over all tiles."""
    for _ in numba.prange(workers):
        s = np.empty(PLANE * PLANES, np.float32)
        for tile in pieces(counter, grid.tiles_x * grid.tiles_y):
            if _is_empty(tile, lists):
                _write_empty_tile(tile, grid, frame)
            else:
                _open_tile(s, tile, grid)
                _draw_tile(s, tile, lists, limits)
                _write_tile(s, tile, grid, frame)


@part()
def _reopen_tile(s, tile, grid, frame, pulled):
    """Load the end state of a tile and dL/d(frame); return the place of its last drawn Gaussian."""
    _open_tile(s, tile, grid)
    transmittance, last = frame.transmittance, frame.last
    colors, depth, alpha = pulled.colors, pulled.depth, pulled.alpha
    furthest, first = np.int64(-1), np.uint64(tile * AREA)
    for p in range(np.uint64(AREA)):
        s[T + p] = transmittance[first + p]
        s[LAST + p] = last[first + p]
        furthest = max(furthest, np.int64(last[first + p]))
    for run in range(RUNS):
        p, at, number = _pixels_of(run, tile, grid)
        for k in range(number):
            s[U + p + k], s[F3 + p + k] = alpha[at + k], depth[at + k]
        for channel in range(_CHANNELS):
            plane, of = F0 + np.uint64(PLANE) * channel + p, at * _CHANNELS + channel
            for k in range(number):
                s[plane + k] = colors[of + k * _CHANNELS]
    return furthest


@part()
def _backward_tile(s, tile, furthest, lists, limits, grads):
    """Walk the list of a tile back to front; each entry writes its own row of gradients."""
    records, ranks, row_ranges = lists.records, lists.ranks, lists.row_ranges
    first = lists.first_entry[tile]
    for place in range(lists.first_entry[tile + 1] - first - 1, -1, -1):
        sums, base = NO_SUMS, ranks[first + place] * RECORD
        _fetch(records, ranks[first + max(place - AHEAD, 0)], RECORD)
        for block in range(BLOCKS):
            start, stop = _row_range(row_ranges, first + place, block)
            if start < stop and place <= furthest:
                sums = backward(s, records, base, np.float32(place), start, stop, limits, sums)
        write_row(sums, records[base + OPACITY], grads, (first + place) * WIDTH)


@kernel(parallel=True)
def backward_frame(lists, grid, frame, pulled, limits, grads, counter, workers):
    """Backward pass over all tiles: dL/d(frame), `pulled`, to one row of `grads` per entry."""
    for _ in numba.prange(workers):
        s = np.empty(PLANE * PLANES, np.float32)
        for tile in pieces(counter, grid.tiles_x * grid.tiles_y):
            if not _is_empty(tile, lists):
                furthest = _reopen_tile(s, tile, grid, frame, pulled)
                _backward_tile(s, tile, furthest, lists, limits, grads)


@kernel(parallel=True)
def sum_rows(lists, grads, sums, counter, workers):
    """Sum the rows of each Gaussian in float64, always in the same order, into its row of
    `sums`."""
    ids, first_slot, entries = lists.ids, lists.first_slot, lists.entries
    for _ in numba.prange(workers):
        total, last = np.empty(WIDTH, np.float64), entries.size - 1
        for start, stop in batches(counter, ids.size, ROWS_CHUNK):
            for rank in range(start, stop):
                total[:] = 0
                for slot in range(first_slot[rank], first_slot[rank + 1]):
                    _fetch(grads, entries[min(slot + ROWS_AHEAD, last)], WIDTH)
                    row = entries[slot] * WIDTH
                    for k in range(WIDTH):
                        total[k] += grads[row + k]
                for k in range(WIDTH):
                    sums[ids[rank] * WIDTH + k] = total[k]
