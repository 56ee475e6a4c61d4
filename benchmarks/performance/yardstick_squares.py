"""The yardstick on the lists that gsplat 1.4 makes: every tile that the square of 3 sigma touches.

That is what a plain rasterizer usually starts from; the lists are half as long again as exact ones.
"""

from __future__ import annotations

import torch
from torch import Tensor

from benchmarks.performance.yardstick import draw
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.tile_lists import TILE, TileLists, pairs_of_boxes, sorted_lists, tile_grid
from desplat_ns.studies.pixels.contenders import Contender


class SquaresYardstick:
    """See `protocol.Rasterizer`; it has no absgrad, and cuts opaque Gaussians off at 3 sigma."""

    name = "yardstick, squares"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`."""
        projected = project(splats, view, settings)
        lists = tile_lists(projected, view.width, view.height)
        return draw(projected, lists, view, settings)


@torch.no_grad()
def tile_lists(projected: ProjectedSplats, width: int, height: int) -> TileLists:
    """For each tile, the Gaussians whose square touches it, nearest first."""
    grid = tile_grid(width, height)
    seen = (projected.radii > 0).nonzero()[:, 0]
    seen = seen[torch.sort(projected.depths[seen], stable=True).indices]
    low, high = squares(projected.means2d[0, seen], projected.radii[seen], grid)
    return sorted_lists(*pairs_of_boxes(low, high, grid[0]), seen, grid)


def squares(means2d: Tensor, radii: Tensor, grid: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """First and one past the last tile (column, row) of each square, [N, 2]."""
    limit, radii = torch.tensor(grid), radii[:, None]
    low = torch.minimum(((means2d - radii) / TILE).floor().clamp(min=0), limit).long()
    high = torch.minimum(((means2d + radii) / TILE).ceil().clamp(min=0), limit).long()
    return low, torch.maximum(low, high)


SQUARES = Contender(SquaresYardstick.name, "cpu", SquaresYardstick(), seam="project")
"""Takes part in the timing of rasterizers only: its picture is another one."""
