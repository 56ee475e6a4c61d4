"""Draws the outline of regions along the edges of the photo.

Residuals are averaged over some cells, so a region found in them ends some cells beyond the thing
that it is for. The thing itself ends where the photo's colours change.

Source: guided filter of He, Sun and Tang 2010 (Eq. 14 to 16, with a colour guide), of the regions
by the photo.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.separation.grid import window_means

WINDOW = 13
"""Cells (an odd number) over which a region is explained by the photo's colours."""

NOISE = 1e-4
"""Variance of colours in [0, 1] that is no edge."""


def along_edges(
    regions: Bool[Tensor, "rows columns"], colors: Float[Tensor, "3 rows columns"]
) -> Bool[Tensor, "rows columns"]:
    """The regions, each cell given to the side whose colours it has.

    Around each cell the regions are fitted by a linear function of the colours; where the mean of
    all fits is above a half is inside.

    Args:
        colors: of the photo in cells, in [0, 1].
    """
    colors = colors.double()  # grey surroundings make the systems below nearly singular
    inside = regions.to(colors)
    guide, target = window_means(colors, WINDOW), window_means(inside[None], WINDOW)[0]
    both = window_means(colors * inside, WINDOW) - guide * target
    slope = _solved(_covariance(colors, guide), both)
    offset = target - (slope * guide).sum(dim=0)
    fitted = window_means(torch.cat([slope, offset[None]]), WINDOW)
    return (fitted[:3] * colors).sum(dim=0) + fitted[3] > 0.5


def _covariance(
    colors: Float[Tensor, "3 rows columns"], means: Float[Tensor, "3 rows columns"]
) -> tuple[Tensor, ...]:
    """Variances and covariances rr, gg, bb, gb, rb, rg within windows; noise added to variances."""
    first, second = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    products = window_means(colors[first] * colors[second], WINDOW) - means[first] * means[second]
    return (*(products[:3].clamp(min=0) + NOISE), *products[3:])


def _solved(
    covariance: tuple[Tensor, ...], right: Float[Tensor, "3 rows columns"]
) -> Float[Tensor, "3 rows columns"]:
    """Solution of the symmetric 3 x 3 system of each cell, by cofactors."""
    rr, gg, bb, gb, rb, rg = covariance
    c00, c01, c02 = gg * bb - gb * gb, gb * rb - rg * bb, rg * gb - gg * rb
    c11, c12, c22 = rr * bb - rb * rb, rg * rb - rr * gb, rr * gg - rg * rg
    determinant = rr * c00 + rg * c01 + rb * c02
    r, g, b = right
    solution = (
        c00 * r + c01 * g + c02 * b,
        c01 * r + c11 * g + c12 * b,
        c02 * r + c12 * g + c22 * b,
    )
    return torch.stack(solution) / determinant
