"""The yardstick on the lists that gsplat 1.4 makes: every tile that the square of 3 sigma touches.

That is what a plain rasterizer usually starts from; the lists are half as long again as exact ones.
"""

from __future__ import annotations

import torch

from benchmarks.yardstick import draw
from desplat_ns.backend.projection import ProjectedSplats, project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from desplat_ns.backend.tile_lists import TILE, TileLists, _pairs, tile_grid


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
    columns, rows = tile_grid(width, height)
    seen = (projected.radii > 0).nonzero()[:, 0]
    seen = seen[torch.sort(projected.depths[seen], stable=True).indices]
    means, radii = projected.means2d[0, seen], projected.radii[seen, None]
    limit = torch.tensor([columns, rows])
    low = torch.minimum(((means - radii) / TILE).floor().clamp(min=0), limit).long()
    high = torch.minimum(((means + radii) / TILE).ceil().clamp(min=0), limit).long()
    tile, rank = _pairs(low, torch.maximum(low, high), columns)
    key = torch.sort(tile * len(seen) + rank).values
    counts = torch.bincount(tile, minlength=columns * rows)
    return TileLists(
        gaussians=seen[key % max(len(seen), 1)],
        starts=counts.cumsum(0) - counts,
        counts=counts,
        columns=columns,
        rows=rows,
    )
