"""How many (pixel, Gaussian) pairs there are, are looked at, and contribute."""

from __future__ import annotations

from dataclasses import dataclass
from types import FunctionType

import numba
import numpy as np
import torch

from desplat_ns.backend import numba_tiles
from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.numba_kernels.binning import Gaussians, Grid, Lists, tile_lists
from desplat_ns.backend.numba_kernels.ellipses import FEATURES
from desplat_ns.backend.numba_kernels.passes import _draw_tile, _open_tile
from desplat_ns.backend.numba_kernels.pixels import PLANE, PLANES_BEFORE_FEATURES, WEIGHT, blend
from desplat_ns.backend.projection import ProjectedSplats
from desplat_ns.backend.protocol import RenderSettings
from desplat_ns.backend.tile_lists import TILE, tile_grid
from desplat_ns.calibration.scenes import Scene
from lab.pixels.square_lists import squares


@dataclass(frozen=True)
class Pairs:
    """Numbers of (pixel, Gaussian) pairs in one picture."""

    square: int
    """In lists of every tile that the 3-sigma square touches (gsplat 1.4)."""
    listed: int
    """In the `numba` backend's lists: every tile where the Gaussian can be seen."""
    evaluated: int
    """Left after rows of tiles are skipped and finished tiles stop."""
    contributing: int
    """Drawn: alpha reaches the cutoff and the pixel is still open."""


@torch.no_grad()
def count_pairs(scene: Scene) -> Pairs:
    """Count with the `numba` backend's own lists and kernels."""
    view, splats = scene.view, scene.splats()
    projected = numba_tiles._project(splats, view, RenderSettings())
    lists, stride, grid = lists_of(projected, view.width, view.height)
    evaluated, contributing = _count(lists, stride, grid, numba_tiles._LIMITS)
    area = TILE * TILE
    square = square_entries(projected, view.width, view.height)
    return Pairs(square * area, lists.ranks.size * area, int(evaluated), int(contributing))


def lists_of(projected: ProjectedSplats, width: int, height: int) -> tuple[Lists, int, Grid]:
    """The `numba` backend's lists, the stride of their records, and the grid of tiles."""
    grid = Grid(width, height, -(-width // TILE), -(-height // TILE))
    values = (projected.means2d, projected.conics, projected.depths, projected.opacities)
    flat = [t.detach().contiguous().view(-1).numpy() for t in (*values, projected.colors)]
    gaussians = Gaussians(*flat, channels=projected.colors.shape[1])
    radii = projected.radii.numpy()
    return *tile_lists(gaussians, radii, grid, False, ALPHA_CUTOFF), grid


def square_entries(projected: ProjectedSplats, width: int, height: int) -> int:
    """Tiles that the squares of 3 sigma touch, summed over all Gaussians."""
    mask = projected.radii > 0
    low, high = squares(projected.means2d[0, mask], projected.radii[mask], tile_grid(width, height))
    return int((high - low).prod(dim=-1).sum())


@numba.njit
def _counting_blend(s, records, base, place, start, stop, limits):
    """`blend`; counts pixels looked at and pixels drawn in the last two places of `s`."""
    blend(s, records, base, place, start, stop, limits)
    drawn = 0
    for p in range(start, stop):
        drawn += s[WEIGHT + np.uint64(p)] > 0
    s[s.size - 2] += stop - start
    s[s.size - 1] += drawn


_counting_draw_tile = numba.njit(
    FunctionType(
        _draw_tile.py_func.__code__,
        {**_draw_tile.py_func.__globals__, "blend": _counting_blend},
    )
)
"""The backend's own loop over a tile's list, whatever it is, that calls the function above."""


@numba.njit
def _count(lists, stride, grid, limits):
    """(evaluated, contributing): the forward pass over all tiles, counting."""
    evaluated = contributing = 0
    s = np.empty(PLANE * (PLANES_BEFORE_FEATURES + stride - FEATURES) + 2, np.float32)
    for tile in range(grid.tiles_x * grid.tiles_y):
        _open_tile(s, tile, grid)
        s[s.size - 2 :] = 0
        _counting_draw_tile(s, tile, lists, stride, limits)
        evaluated += np.int64(s[s.size - 2])
        contributing += np.int64(s[s.size - 1])
    return evaluated, contributing
