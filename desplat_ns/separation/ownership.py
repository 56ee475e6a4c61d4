"""Which pixels belong to the distractors, and so do not count in the static scene's loss."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.separation.grid import grid_of

OWNED_MARGIN = 1.0
"""Cells of `grid_of` by which the pixels that distractors own reach beyond their edge: an edge is
half-transparent, and its leak would be learned."""


def pixels_of(
    regions: Bool[Tensor, "rows columns"], height: int, width: int
) -> Bool[Tensor, "H W 1"]:
    """The pixels whose cell is in a region."""
    cells = regions[None, None].to(torch.float32)
    return F.interpolate(cells, size=(height, width))[0, 0, :, :, None] > 0


def owned_share(
    alpha_d: Float[Tensor, "H W 1"], regions: Bool[Tensor, "rows columns"] | None = None
) -> Float[Tensor, "H W 1"]:
    """How far distractors own a pixel, in [0, 1]: the largest of their opacities around it.

    A pixel in one of `regions` counts as theirs even if they cover nothing of it.
    """
    height, width = alpha_d.shape[:2]
    margin = round(OWNED_MARGIN * width / grid_of(width, height)[0])
    plane, window = alpha_d.detach()[..., 0], 2 * margin + 1
    rows = F.max_pool1d(plane, window, 1, margin)  # row by row: a tenth of max_pool2d's time
    owned = F.max_pool1d(rows.T.contiguous(), window, 1, margin).T[..., None]
    return owned if regions is None else owned.masked_fill(pixels_of(regions, height, width), 1.0)
