"""The lists that gsplat 1.4 makes: every tile that the square of 3 sigma touches.

That is what a plain rasterizer usually starts from. They are half as long again as exact ones, and
what an opaque Gaussian still shows beyond the tiles of its square is not drawn.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from desplat_ns.backend.numba_kernels import binning
from desplat_ns.backend.numba_kernels.ellipses import BLOCKS, MEAN_X, MEAN_Y
from desplat_ns.backend.projection import ProjectedSplats
from desplat_ns.backend.tile_lists import TILE, TileLists, pairs_of_boxes, sorted_lists, tile_grid


@torch.no_grad()
def square_lists(projected: ProjectedSplats, width: int, height: int) -> TileLists:
    """For each tile, the Gaussians whose square touches it, nearest first: for plain torch."""
    grid = tile_grid(width, height)
    visible = (projected.radii > 0).nonzero()[:, 0]
    visible = visible[torch.sort(projected.depths[visible], stable=True).indices]
    low, high = squares(projected.means2d[0, visible], projected.radii[visible], grid)
    return sorted_lists(*pairs_of_boxes(low, high, grid[0]), visible, grid)


def squares(means2d: Tensor, radii: Tensor, grid: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """First and one past the last tile (column, row) of each square, [N, 2]."""
    limit, radii = torch.tensor(grid), radii[:, None]
    low = torch.minimum(((means2d - radii) / TILE).floor().clamp(min=0), limit).long()
    high = torch.minimum(((means2d + radii) / TILE).ceil().clamp(min=0), limit).long()
    return low, torch.maximum(low, high)


class CompiledSquareLists:
    """The same for the compiled kernels, in the place of `binning.tile_lists`, of one scene.

    The kernels have no maker of squares. Every call makes exact lists, so that its time counts, and
    gives those of the squares instead, which are made in the first call and kept. A compiled maker
    would do less work for each entry and write half as many entries again.
    """

    def __init__(self) -> None:
        self._entries: dict[str, np.ndarray] | None = None

    def __call__(
        self,
        gaussians: binning.Gaussians,
        radii: np.ndarray,
        grid: binning.Grid,
        with_depth: bool,
        cutoff: float,
    ) -> tuple[binning.Lists, int]:
        """As `binning.tile_lists`."""
        exact, stride = binning.tile_lists(gaussians, radii, grid, with_depth, cutoff)
        if self._entries is None:
            self._entries = _square_entries(exact, stride, radii, (grid.tiles_x, grid.tiles_y))
        return exact._replace(**self._entries), stride


def _square_entries(
    exact: binning.Lists, stride: int, radii: np.ndarray, grid: tuple[int, int]
) -> dict[str, np.ndarray]:
    """What differs in `Lists`: which entries there are, each over all rows of its tile."""
    records = torch.from_numpy(exact.records).view(-1, stride)
    means2d = records[:, [MEAN_X, MEAN_Y]]
    low, high = squares(means2d, torch.from_numpy(radii[exact.ids]), grid)
    tile, rank = pairs_of_boxes(low, high, grid[0])
    count = len(exact.ids)
    key = np.sort((tile * count + rank).numpy())
    ranks = (key % max(count, 1)).astype(np.int32)
    spans = np.zeros((BLOCKS, 2, len(key)), np.uint8)
    spans[:, 1] = TILE
    return {
        "first_slot": _starts(ranks, count),
        "first_entry": _starts(key // max(count, 1), grid[0] * grid[1]),
        "ranks": ranks,
        "entries": np.argsort(ranks, kind="stable").astype(np.int32),
        "row_ranges": spans.reshape(-1),
    }


def _starts(labels: np.ndarray, count: int) -> np.ndarray:
    """[count + 1] where each label's run would start if the labels were sorted; then their end."""
    return np.concatenate([[0], np.bincount(labels, minlength=count).cumsum()]).astype(np.int32)
