from __future__ import annotations

import numpy as np

from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.numba_kernels.binning import Gaussians, Grid, Lists, tile_lists
from desplat_ns.backend.numba_kernels.ellipses import BLOCK, TILE
from desplat_ns.backend.numba_kernels.passes import (
    RUNS,
    Frame,
    _open_tile,
    _run,
    backward_frame,
    draw_frame,
    sum_rows,
)
from desplat_ns.backend.numba_kernels.pixels import (
    AREA,
    GEOMETRY,
    LAST,
    PLANE,
    PLANES_BEFORE_FEATURES,
    Limits,
    T,
    X,
    Y,
)
from desplat_ns.backend.numba_kernels.runtime import new_counter

GRID = Grid(20, 18, 2, 2)


def test_the_runs_of_a_tile_are_a_rearrangement_of_its_square():
    starts = [_run(run, 3, GRID) for run in range(RUNS)]
    pixels = [(x + k, y) for x, y in starts for k in range(BLOCK)]
    assert set(pixels) == {(x, y) for x in range(16, 32) for y in range(16, 32)}
    assert len(pixels) == AREA
    assert starts[:2] == [(16, 16), (16, 17)]
    assert starts[TILE] == (16 + BLOCK, 16)


def test_runs_outside_the_image_are_finished_from_the_start():
    s = np.full(PLANE * (PLANES_BEFORE_FEATURES + 4), np.nan, np.float32)
    _open_tile(s, 3, GRID)
    is_open = s[int(T) : int(T) + AREA] > 0
    x, y = s[int(X) : int(X) + AREA], s[int(Y) : int(Y) + AREA]
    assert (is_open == ((x < 20) & (y < 18))).all()
    assert is_open.sum() == 4 * 2
    assert (x % 1 == 0.5).all()
    assert (s[int(LAST) : int(LAST) + AREA] == -1).all()
    assert TILE * TILE == AREA


def test_rows_are_summed_in_float64_under_the_index_of_their_gaussian():
    ids, first_slot = np.array([2, 0], np.int32), np.array([0, 3, 4], np.int32)
    empty = np.zeros(0, np.int32)
    row_ranges = np.zeros(0, np.uint8)
    entries = np.array([3, 0, 2, 1], np.int32)
    lists = Lists(ids, np.zeros(0, np.float32), first_slot, empty, empty, entries, row_ranges)
    # In float32, 2^24 + 1 - 2^24 is 0.
    grads = np.array([1, 2, 5, 6, -(2**24), 3, 2**24, 1], np.float32)
    sums = np.zeros((3, 2), np.float32)
    sum_rows(lists, grads, 2, sums.reshape(-1), new_counter(), 1)
    assert sums.tolist() == [[5, 6], [0, 0], [1, 6]]


def test_tiles_without_gaussians_show_nothing_and_are_left_out_of_the_backward_pass():
    """All memory is NaN at first. One small Gaussian, in the first of four tiles."""
    numbers = ([4, 4], [1, 0, 1], [1], [0.5], [1, 1, 1])
    gaussians = Gaussians(*(np.array(n, np.float32) for n in numbers), channels=3)
    lists, stride = tile_lists(gaussians, np.ones(1, np.int32), GRID, True, ALPHA_CUTOFF)
    limits = Limits(np.float32(0.999), np.float32(ALPHA_CUTOFF), np.float32(1e-4))
    pixels, area = GRID.width * GRID.height, GRID.tiles_x * GRID.tiles_y * AREA
    sizes = (3 * pixels, pixels, pixels, area, area)
    frame = Frame(*(np.full(size, np.nan, np.float32) for size in sizes))
    draw_frame(lists, stride, GRID, frame, 3, limits, new_counter(), 1)
    alpha = frame.alpha.reshape(GRID.height, GRID.width)
    assert alpha[:8, :8].any() and not alpha[TILE:].any() and not alpha[:, TILE:].any()
    # Its weight is a feature times alpha; 1 - T is rounded twice more.
    assert (np.abs(frame.depth - frame.alpha) <= 2**-23).all()
    assert (frame.colors.reshape(-1, 3) == frame.depth[:, None]).all()
    grads = np.full(lists.ranks.size * (GEOMETRY + 4), np.nan, np.float32)
    pulled = frame._replace(colors=np.ones_like(frame.colors))
    backward_frame(lists, stride, GRID, frame, pulled, 3, limits, grads, new_counter(), 1)
    assert np.isfinite(grads).all()
