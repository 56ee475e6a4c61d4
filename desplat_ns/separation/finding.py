"""Finds the regions of a photo that show what the other views do not.

Each of three things has a say: how far the photo is from the static scene, beyond what is usual in
a place; whether it has the scene's own detail in another light; and where a region was when the
view was last seen.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.separation.expected_residual import (
    UsualResiduals,
    excess_residual,
    local_residual,
)
from desplat_ns.separation.grid import counted_cells, grid_of, pooled
from desplat_ns.separation.outlines import along_edges
from desplat_ns.separation.regions import outlier_regions
from desplat_ns.separation.shared_detail import shared_detail
from desplat_ns.separation.visit import Visit


def find_regions(
    visit: Visit,
    opacities: Float[Tensor, "N 1"],
    known: UsualResiduals,
    num_views: int,
    config: DistractorConfig,
    last: Bool[Tensor, "rows columns"] | None = None,
) -> tuple[Bool[Tensor, "rows columns"], UsualResiduals]:
    """Find the regions of a photo that show what other views do not, on the grid of `grid_of`.

    Args:
        opacities: logits of the static Gaussians.
        known: what they remember of other visits.
        num_views: number of training views.
        last: regions of the view's last visit; None if there are none.

    Returns:
        The regions, and what is known once this visit is remembered too. Masked cells are in none.
    """
    width, height = visit.view.width, visit.view.height
    grid = grid_of(width, height)
    counted = None if visit.mask is None else counted_cells(visit.mask, grid)
    x, y = visit.static.means2d.detach()[0].unbind(-1)
    static = visit.static_rgb.detach()
    excess, learned = excess_residual(
        local_residual(static, visit.photo, grid, visit.mask),
        torch.stack([x * (grid[0] / width), y * (grid[1] / height)], dim=-1),
        visit.static.visible,
        torch.sigmoid(opacities.detach()[:, 0]),
        known,
        num_views,
        counted,
    )
    own = shared_detail(static, visit.photo, visit.mask) <= config.shared_detail
    weak = (excess.values > config.weak_excess) & own
    most = config.strong_excess
    needed = excess.needed(config.strong_levels, config.settled_share * most, most)
    strong = excess.values > needed
    if last is not None:
        strong |= last & (excess.values > config.standing_share * needed)
    strong &= own
    regions = outlier_regions(weak, strong)
    regions = along_edges(regions, pooled(visit.photo, grid, visit.mask))
    return regions if counted is None else regions & counted, learned
