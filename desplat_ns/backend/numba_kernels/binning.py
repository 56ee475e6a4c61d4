"""Which Gaussians can be seen in which tile, exactly, in depth order.

The lists come from a counting sort over the Gaussians in the order of (depth, index): each chunk
counts its entries per tile, the counts are summed up, then each chunk writes its own places.
"""

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
    RECORD,
    TILE,
    block_rows,
    columns,
    ellipse,
    tile_rows,
)
from desplat_ns.backend.numba_kernels.runtime import kernel, launch, part, pieces

CHUNK = 512
"""Gaussians that one worker bins at a time."""


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
    """[R * RECORD] mean, conic, opacity, colours, depth."""
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


@part()
def _tiles(e, grid):
    """Rows of tiles that an ellipse touches: which, and their first and end column of tiles."""
    first, end = tile_rows(e, grid)
    for ty in range(first, end):
        start, stop = columns(e, ty, grid)
        yield ty, start // TILE, (stop + TILE - 1) // TILE if start < stop else start // TILE


@kernel(parallel=True)
def _count(gaussians, ids, records, cutoff, grid, counts, sizes, outlines, counter, workers):
    """Gather records and outlines; count entries per chunk and tile (`counts`) and per rank
    (`sizes`, one place on)."""
    means2d, conics, depths, opacities, colors = gaussians
    for _ in numba.prange(workers):
        for chunk in pieces(counter, counts.shape[0]):
            for rank in range(chunk * CHUNK, min((chunk + 1) * CHUNK, ids.size)):
                i, base, at = ids[rank], rank * RECORD, rank * OUTLINE
                records[base + MEAN_X], records[base + MEAN_Y] = means2d[2 * i], means2d[2 * i + 1]
                records[base + CONIC_A], records[base + CONIC_B] = conics[3 * i], conics[3 * i + 1]
                records[base + CONIC_C], records[base + OPACITY] = conics[3 * i + 2], opacities[i]
                for k in range(3):
                    records[base + FEATURES + k] = colors[3 * i + k]
                records[base + FEATURES + 3] = depths[i]
                e = ellipse(records, base, cutoff)
                outlines[at], outlines[at + 1] = e.mean_x, e.mean_y
                outlines[at + 2], outlines[at + 3] = e.slope_y, e.extent_x
                outlines[at + 4], outlines[at + 5] = e.root_y, e.bend_y
                outlines[at + 6] = e.top_y
                for ty, start, stop in _tiles(e, grid):
                    sizes[rank + 1] += stop - start
                    for tx in range(start, stop):
                        counts[chunk, ty * grid.tiles_x + tx] += 1


@kernel(parallel=True)
def _fill(lists, cutoff, grid, places, counter, workers):
    """Write the entries of each chunk at its places, by chunk and tile."""
    # Taken apart here: numba counts references, atomically, where an array leaves a tuple.
    records, first_slot = lists.records, lists.first_slot
    ranks, entries = lists.ranks, lists.entries
    for _ in numba.prange(workers):
        for chunk in pieces(counter, places.shape[0]):
            for rank in range(chunk * CHUNK, min((chunk + 1) * CHUNK, first_slot.size - 1)):
                slot = first_slot[rank]
                for ty, start, stop in _tiles(ellipse(records, rank * RECORD, cutoff), grid):
                    for tx in range(start, stop):
                        entry = places[chunk, ty * grid.tiles_x + tx]
                        places[chunk, ty * grid.tiles_x + tx] = entry + 1
                        ranks[entry], entries[slot] = rank, entry
                        slot += 1


@kernel(parallel=True)
def _write_spans(lists, grid, outlines, counter, workers):
    """Fill in `lists.row_ranges`, a batch of entries at a time."""
    first_entry, ranks, row_ranges = lists.first_entry, lists.ranks, lists.row_ranges
    for _ in numba.prange(workers):
        s = np.empty(OUTLINE * BATCH, np.float32)
        for tile in pieces(counter, grid.tiles_x * grid.tiles_y):
            low = (tile // grid.tiles_x) * TILE
            high = min(low + TILE, grid.height)
            for first in range(first_entry[tile], first_entry[tile + 1], BATCH):
                number = min(BATCH, first_entry[tile + 1] - first)
                for k in range(number):
                    for value in range(OUTLINE):
                        s[value * BATCH + k] = outlines[ranks[first + k] * OUTLINE + value]
                for block in range(BLOCKS):
                    left = np.float32((tile % grid.tiles_x) * TILE + block * BLOCK)
                    at = 2 * block * ranks.size + first
                    block_rows(
                        s, number, left, np.float32(low), np.float32(high),
                        row_ranges, np.uint64(at), np.uint64(at + ranks.size),
                    )  # fmt: skip


def tile_lists(
    gaussians: tuple[np.ndarray, ...], radii: np.ndarray, grid: Grid, cutoff: float
) -> Lists:
    """Bin the Gaussians with radii > 0, whose depths are positive. `gaussians`: means2d, conics,
    depths, opacities, colours [N * 3]; flat float32."""
    _, conics, depths, opacities, _ = gaussians
    seen = (radii > 0) & (opacities >= cutoff) & (conics[::3] > 0) & (conics[2::3] > 0)
    keys = np.flatnonzero(seen)
    keys |= depths.view(np.int32)[keys].astype(np.int64) << 32  # positive: ordered like their bits
    keys.sort()
    ids = (keys & 0xFFFFFFFF).astype(np.int32)
    records = np.empty(ids.size * RECORD, np.float32)
    outlines = np.empty(ids.size * OUTLINE, np.float32)
    first_slot = np.zeros(ids.size + 1, np.int32)
    counts = np.zeros((ids.size // CHUNK + 1, grid.tiles_x * grid.tiles_y), np.int32)
    launch(_count, gaussians, ids, records, cutoff, grid, counts, first_slot, outlines)
    np.cumsum(first_slot, out=first_slot)
    ends = np.cumsum(counts.T, dtype=np.int32).reshape(counts.T.shape)  # by tile, then chunk
    first_entry = np.append(np.int32(0), ends[:, -1])
    np.subtract(ends.T, counts, out=counts)
    ranks, entries = np.empty((2, first_entry[-1]), np.int32)
    row_ranges = np.empty(2 * BLOCKS * ranks.size, np.uint8)
    lists = Lists(ids, records, first_slot, first_entry, ranks, entries, row_ranges)
    launch(_fill, lists, cutoff, grid, counts)
    launch(_write_spans, lists, grid, outlines)
    return lists
