"""Which Gaussians can be seen in which tile, exactly, in depth order.

The lists come from a counting sort over the Gaussians in the order of (depth, index): each chunk of
Gaussians counts its entries per tile, the counts are summed up, then each chunk writes its own
places.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.ellipses import (
    BATCH,
    BLOCK,
    BLOCKS,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FEATURES,
    MEAN_X,
    MEAN_Y,
    OPACITY,
    OUTLINE,
    TILE,
    block_rows,
    columns,
    ellipse,
    tile_rows,
)
from desplat_ns.backend.numba_kernels.runtime import kernel, new_counter, num_workers, part, take

CHUNK = 512
"""Gaussians that one worker bins at a time."""


class Gaussians(NamedTuple):
    """Projected Gaussians as flat arrays, float32."""

    means2d: np.ndarray
    conics: np.ndarray
    depths: np.ndarray
    opacities: np.ndarray
    colors: np.ndarray
    channels: int


class Grid(NamedTuple):
    """The image in tiles."""

    width: int
    height: int
    tiles_x: int
    tiles_y: int


class Lists(NamedTuple):
    """What each tile draws. R visible Gaussians, E (Gaussian, tile) entries."""

    ids: np.ndarray
    """[R] index of the Gaussian of each rank in depth order."""
    records: np.ndarray
    """[R * stride] mean, conic, opacity, features (colours, then depth, then zeros)."""
    first_slot: np.ndarray
    """[R + 1] rank r owns the slots first_slot[r] ... first_slot[r + 1] - 1 of `entries`."""
    first_entry: np.ndarray
    """[tiles + 1] entries of tile t are first_entry[t] ... first_entry[t + 1] - 1, front to
    back."""
    ranks: np.ndarray
    """[E] rank of the entry's Gaussian."""
    entries: np.ndarray
    """[E] the entries of rank 0, then those of rank 1, ..."""
    row_ranges: np.ndarray
    """[2 * BLOCKS * E] rows of the tile to look at: first rows of all entries in block 0, end rows
    in block 0, first rows in block 1, ..."""


@kernel()
def _visible_keys(gaussians, depth_bits, radii, cutoff, keys):
    """Write the sort keys (depth, index) of all Gaussians that can be seen; return how many."""
    means2d, conics, depths, opacities = gaussians[:4]
    count = 0
    for i in range(radii.size):
        if radii[i] <= 0 or not opacities[i] >= cutoff:
            continue
        mx, my = means2d[2 * i], means2d[2 * i + 1]
        a, b, c = conics[3 * i], conics[3 * i + 1], conics[3 * i + 2]
        if not (a > 0 and c > 0 and math.isfinite(mx + my + a + b + c + depths[i])):
            continue
        bits = np.uint64(depth_bits[i])
        flip = np.uint64(0xFFFFFFFF) if bits >> np.uint64(31) else np.uint64(0x80000000)
        keys[count] = ((bits ^ flip) << np.uint64(32)) | np.uint64(i)
        count += 1
    return count


@part()
def _write_records(gaussians, ids, records, stride, start, stop):
    """Gather mean, conic, opacity and features of the ranks start ... stop - 1."""
    means2d, conics, depths, opacities, colors, channels = gaussians
    for rank in range(start, stop):
        i, base = ids[rank], rank * stride
        records[base + MEAN_X], records[base + MEAN_Y] = means2d[2 * i], means2d[2 * i + 1]
        records[base + CONIC_A], records[base + CONIC_B] = conics[3 * i], conics[3 * i + 1]
        records[base + CONIC_C], records[base + OPACITY] = conics[3 * i + 2], opacities[i]
        for k in range(FEATURES, stride):
            records[base + k] = 0.0
        for k in range(channels):
            records[base + FEATURES + k] = colors[channels * i + k]
        if channels < stride - FEATURES:
            records[base + FEATURES + channels] = depths[i]


@part()
def _count_tiles(e, grid, counts, chunk, edges, row):
    """Count the tiles of an ellipse into counts[chunk]; return how many there are.

    `edges` gets first and end column of tiles, from place `row` on: one pair per row of tiles.
    """
    number, (first, end) = 0, tile_rows(e, grid)
    for ty in range(first, end):
        start, stop = columns(e, ty, grid)
        start, stop = start // TILE, (stop + TILE - 1) // TILE if start < stop else start // TILE
        edges[2 * row], edges[2 * row + 1] = start, stop
        row += 1
        number += stop - start
        for tx in range(start, stop):
            counts[chunk, ty * grid.tiles_x + tx] += 1
    return number


@kernel(parallel=True)
def _measure(gaussians, ids, records, stride, cutoff, grid, first_row, counter, workers):
    """Gather the records; count rows of tiles per rank, one place on, into `first_row`."""
    for _ in numba.prange(workers):
        start = take(counter) * CHUNK
        while start < ids.size:
            stop = min(start + CHUNK, ids.size)
            _write_records(gaussians, ids, records, stride, start, stop)
            for rank in range(start, stop):
                first, end = tile_rows(ellipse(records, rank * stride, cutoff), grid)
                first_row[rank + 1] = end - first
            start = take(counter) * CHUNK


@kernel(parallel=True)
def _count(
    records, stride, cutoff, grid, first_row, edges, counts, sizes, outlines, counter, workers
):
    """Count entries per chunk and tile (`counts`) and per rank (`sizes`, one place on)."""
    for _ in numba.prange(workers):
        chunk = take(counter)
        while chunk < counts.shape[0]:
            for rank in range(chunk * CHUNK, min((chunk + 1) * CHUNK, sizes.size - 1)):
                e = ellipse(records, rank * stride, cutoff)
                sizes[rank + 1] = _count_tiles(e, grid, counts, chunk, edges, first_row[rank])
                at = rank * OUTLINE
                outlines[at], outlines[at + 1] = e.mean_x, e.mean_y
                outlines[at + 2], outlines[at + 3] = e.slope_y, e.extent_x
                outlines[at + 4], outlines[at + 5] = e.root_y, e.bend_y
                outlines[at + 6] = e.top_y
                outlines[at + 7] = tile_rows(e, grid)[0]
            chunk = take(counter)


@kernel()
def _sum_up(counts, first_entry):
    """Turn counts[chunk, tile] into first places, by tile, then chunk."""
    total = 0
    for tile in range(counts.shape[1]):
        first_entry[tile] = total
        for chunk in range(counts.shape[0]):
            number = counts[chunk, tile]
            counts[chunk, tile] = total
            total += number
    first_entry[counts.shape[1]] = total
    return total


@kernel(parallel=True)
def _fill(lists, grid, first_row, edges, outlines, places, counter, workers):
    """Write the entries of each chunk at the places that `_sum_up` gave it."""
    # Taken apart here: numba counts references, atomically, where an array leaves a tuple.
    ids, first_slot, ranks, entries = lists.ids, lists.first_slot, lists.ranks, lists.entries
    for _ in numba.prange(workers):
        chunk = take(counter)
        while chunk < places.shape[0]:
            for rank in range(chunk * CHUNK, min((chunk + 1) * CHUNK, ids.size)):
                slot, ty = first_slot[rank], np.int64(outlines[rank * OUTLINE + 7])
                for row in range(first_row[rank], first_row[rank + 1]):
                    for tx in range(edges[2 * row], edges[2 * row + 1]):
                        entry = places[chunk, ty * grid.tiles_x + tx]
                        places[chunk, ty * grid.tiles_x + tx] = entry + 1
                        ranks[entry], entries[slot] = rank, entry
                        slot += 1
                    ty += 1
            chunk = take(counter)


@kernel(parallel=True)
def _write_spans(lists, grid, outlines, counter, workers):
    """Fill in `lists.row_ranges`, a batch of entries at a time."""
    first_entry, ranks, row_ranges = lists.first_entry, lists.ranks, lists.row_ranges
    for _ in numba.prange(workers):
        s = np.empty(OUTLINE * BATCH, np.float32)
        tile = take(counter)
        while tile < grid.tiles_x * grid.tiles_y:
            low = (tile // grid.tiles_x) * TILE
            high = min(low + TILE, grid.height)
            for first in range(first_entry[tile], first_entry[tile + 1], BATCH):
                number = min(BATCH, first_entry[tile + 1] - first)
                for k in range(number):
                    for value in range(OUTLINE - 1):
                        s[value * BATCH + k] = outlines[ranks[first + k] * OUTLINE + value]
                for block in range(BLOCKS):
                    left = np.float32((tile % grid.tiles_x) * TILE + block * BLOCK)
                    at = 2 * block * ranks.size + first
                    block_rows(
                        s, number, left, np.float32(low), np.float32(high),
                        row_ranges, np.uint64(at), np.uint64(at + ranks.size),
                    )  # fmt: skip
            tile = take(counter)


def tile_lists(
    gaussians: Gaussians, radii: np.ndarray, grid: Grid, with_depth: bool, cutoff: float
) -> tuple[Lists, int]:
    """Bin the Gaussians with radii > 0. Returns the lists and the stride of their records.

    Features are padded with zeros to a multiple of four, which is what the kernels draw at a time.
    """
    keys = np.empty(radii.size, np.uint64)
    bits = gaussians.depths.view(np.uint32)
    keys = keys[: _visible_keys(gaussians, bits, radii, cutoff, keys)]
    keys.sort()
    ids = (keys & np.uint64(0xFFFFFFFF)).astype(np.int32)
    stride = FEATURES + max(4, -(-(gaussians.channels + with_depth) // 4) * 4)
    records = np.empty(ids.size * stride, np.float32)
    outlines = np.empty(ids.size * OUTLINE, np.float32)
    first_row, first_slot = np.zeros((2, ids.size + 1), np.int32)
    counts = np.zeros((-(-ids.size // CHUNK), grid.tiles_x * grid.tiles_y), np.int32)
    first_entry = np.empty(counts.shape[1] + 1, np.int32)
    common = (records, stride, cutoff, grid, first_row)
    _measure(gaussians, ids, *common, new_counter(), num_workers())
    edges = np.empty(2 * np.cumsum(first_row, out=first_row)[-1], np.int32)
    _count(*common, edges, counts, first_slot, outlines, new_counter(), num_workers())
    np.cumsum(first_slot, out=first_slot)
    number = _sum_up(counts, first_entry)
    ranks, entries = np.empty((2, number), np.int32)
    row_ranges = np.empty(2 * BLOCKS * number, np.uint8)
    lists = Lists(ids, records, first_slot, first_entry, ranks, entries, row_ranges)
    _fill(lists, grid, first_row, edges, outlines, counts, new_counter(), num_workers())
    _write_spans(lists, grid, outlines, new_counter(), num_workers())
    return lists, stride
