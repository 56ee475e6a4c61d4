"""Where a photo shows a sky of its own, of which the other photos say nothing."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled, window_means
from desplat_ns.separation.regions import DETAIL_NOISE, DETAIL_WINDOW

MOST_OPACITY = 0.5
"""Of the static scene, where what is behind it is more of a cell than the scene itself."""


@torch.no_grad()
def own_sky(
    photo: Float[Tensor, "H W 3"], alpha_s: Float[Tensor, "H W 1"]
) -> Bool[Tensor, "rows columns"]:
    """Cells of `grid_of` that show no scene, and no detail in the photo.

    A background of each photo's own stands behind the scene there. What the others show there is
    their sky, so a photo that differs from it need not have anything in front; whatever has no
    detail may be its sky. What has some, if only at its edges, is judged as elsewhere.

    Args:
        photo: in [0, 1].
        alpha_s: opacity of the static scene.
    """
    height, width = photo.shape[:2]
    grid, fine = grid_of(width, height), fine_grid_of(width, height)
    grey = pooled(photo, fine).mean(dim=0)
    mean, square = window_means(torch.stack([grey, grey.square()]), DETAIL_WINDOW)
    variance = pooled((square - mean.square())[..., None], grid)[0]
    return (variance < DETAIL_NOISE) & (pooled(alpha_s, grid)[0] < MOST_OPACITY)
