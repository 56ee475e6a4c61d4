from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.backend.numba_kernels.binning import Gaussians, Grid, _sorted, tile_lists
from desplat_ns.backend.numba_kernels.ellipses import BLOCK, BLOCKS, TILE

CUTOFF = 1 / 255
WIDTH, HEIGHT = 70, 45
_CORNERS = ((0, 0), (0, 1), (1, 1))
GRID = Grid(WIDTH, HEIGHT, 5, 3)


def random_gaussians(seed: int, count: int, largest: float) -> Gaussians:
    rng = np.random.default_rng(seed)
    sigma = np.exp(rng.uniform(np.log(0.55), np.log(largest), (count, 2)))
    angle = rng.uniform(0, np.pi, count)
    u = np.stack([np.cos(angle), np.sin(angle)], -1)
    v = np.stack([-np.sin(angle), np.cos(angle)], -1)
    weights = sigma[:, :, None] ** -2
    axes = np.stack([u, v], 1)
    conics = np.stack(
        [(weights * axes[..., i, None] * axes[..., j, None]).sum((1, 2)) for i, j in _CORNERS], -1
    )
    means = rng.uniform((-10, -10), (WIDTH + 10, HEIGHT + 10), (count, 2))
    return Gaussians(
        means2d=means.astype(np.float32).reshape(-1),
        conics=conics.astype(np.float32).reshape(-1),
        depths=rng.uniform(1, 5, count).astype(np.float32),
        opacities=rng.uniform(0, 1, count).astype(np.float32),
        colors=rng.random(3 * count, np.float32),
        channels=3,
    )


def lists_of(gaussians: Gaussians, radii=None):
    if radii is None:
        radii = np.ones(gaussians.depths.size, np.int32)
    return tile_lists(gaussians, radii, GRID, True, CUTOFF)[0]


def alphas(gaussians: Gaussians, i: int) -> np.ndarray:
    """[H, W] in float64."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x, y = x - float(gaussians.means2d[2 * i]), y - float(gaussians.means2d[2 * i + 1])
    a, b, c = gaussians.conics[3 * i : 3 * i + 3].astype(float)
    return float(gaussians.opacities[i]) * np.exp(-0.5 * (a * x * x + c * y * y) - b * x * y)


def greatest_alpha(gaussians: Gaussians, i: int, left: int) -> np.ndarray:
    """[H], the largest alpha of each row between the outermost centres of a block of columns."""
    a, b, c = gaussians.conics[3 * i : 3 * i + 3].astype(float)
    y = np.arange(HEIGHT) + 0.5 - float(gaussians.means2d[2 * i + 1])
    low = left + 0.5 - float(gaussians.means2d[2 * i])
    x = np.clip(-b * y / a, low, low + BLOCK - 1)
    return float(gaussians.opacities[i]) * np.exp(-0.5 * (a * x * x + c * y * y) - b * x * y)


def looked_at(lists, entry: int, tile: int) -> np.ndarray:
    """[H, W], True where the entry looks: whole rows of blocks of columns."""
    mask = np.zeros((GRID.tiles_y * TILE, GRID.tiles_x * TILE), bool)
    row_ranges = lists.row_ranges.reshape(BLOCKS, 2, -1)[:, :, entry].astype(int)
    top, left = tile // GRID.tiles_x * TILE, tile % GRID.tiles_x * TILE
    for block, (start, stop) in enumerate(row_ranges):
        first = left + block * BLOCK
        mask[top + start : top + stop, first : first + BLOCK] = True
    return mask[:HEIGHT, :WIDTH]


@pytest.mark.parametrize("largest", [3.0, 40.0])
def test_every_pixel_above_the_cutoff_is_looked_at_once_and_no_two_rows_in_vain(largest):
    gaussians = random_gaussians(1, 60, largest)
    lists = lists_of(gaussians)
    looks = np.zeros((60, HEIGHT, WIDTH), int)
    for tile in range(GRID.tiles_x * GRID.tiles_y):
        for entry in range(lists.first_entry[tile], lists.first_entry[tile + 1]):
            looks[lists.ids[lists.ranks[entry]]] += looked_at(lists, entry, tile)
    assert looks.max() == 1
    for i in range(60):
        alpha = alphas(gaussians, i)
        assert looks[i][alpha >= CUTOFF].all()
        for left in range(0, WIDTH, BLOCK):
            rows = looks[i][:, left : left + BLOCK].any(1)
            rows, greatest = np.append(rows, rows[-1]), greatest_alpha(gaussians, i, left)
            assert (rows[::2] == rows[1::2]).all()  # the last one's other is below the image
            greatest = np.append(greatest, 0).reshape(-1, 2).max(1)
            # In EASE, 2e-3 pixels, log alpha changes by less than 3.4 * 2e-3 / 0.55 = 0.013.
            assert (greatest[rows[::2]] >= CUTOFF * (1 - 0.013)).all()


def test_a_tile_lists_the_nearest_first_and_ties_by_index():
    gaussians = random_gaussians(2, 300, 10.0)
    gaussians.depths[:] = np.repeat([2.0, 1.0, 3.0], 100)
    lists = lists_of(gaussians)
    for tile in range(GRID.tiles_x * GRID.tiles_y):
        entries = slice(lists.first_entry[tile], lists.first_entry[tile + 1])
        ids = lists.ids[lists.ranks[entries]]
        assert (np.lexsort((ids, gaussians.depths[ids])) == np.arange(ids.size)).all()


def test_keys_are_sorted_by_all_bits_of_their_upper_halves():
    rng = np.random.default_rng(7)
    depths = np.concatenate([2 ** np.arange(32), rng.integers(0, 2**32, 500), [5, 5]])
    keys = rng.permutation(depths).astype(np.uint64) << np.uint64(32)
    keys |= np.arange(keys.size, dtype=np.uint64)
    assert (_sorted(keys.copy(), np.empty_like(keys)) == np.sort(keys)).all()


def test_culled_faint_and_broken_gaussians_are_left_out():
    gaussians = random_gaussians(5, 6, 5.0)
    gaussians.opacities[:] = 0.5
    gaussians.opacities[1] = 0.9 * CUTOFF
    gaussians.conics[3 * 2] = np.nan
    gaussians.means2d[2 * 3] = np.inf
    gaussians.depths[4] = np.nan
    assert lists_of(gaussians, np.zeros(6, np.int32)).ids.size == 0
    radii = np.array([1, 1, 1, 1, 1, 0], np.int32)
    assert lists_of(gaussians, radii).ids.tolist() == [0]
