"""Tells light from things: where a photo shows the static scene's own detail, nothing is in front.

Flare, exposure and shade change the colours of a place and leave its detail; so does a static scene
that is not sharp yet. Something in front of it has detail of its own, or none. The correlation of
the two is the same for any gain and offset of the colours, so it judges what is left after a light
that is fitted to each place.

Source: normalised cross-correlation, with a floor that stands for noise.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.separation.grid import grid_of, pooled, window_means, window_sums

CELLS = 32000
"""Cells per image: a quarter of those that residuals have in area, or one pixel at 135 x 240."""

SMOOTHING = 3
"""Cells (an odd number) over which both are averaged first: what is only not sharp yet is alike."""

WINDOW = 7
"""Cells (an odd number) over which detail is compared: in a wider window edges of what is in front
count as its own detail far inside, in a narrower one there is little to compare."""

NOISE = 1e-3
"""Added to both variances, of grey in [0, 1]. What differs less from its surroundings is no detail:
before a bare wall, nobody can tell a light from a thing."""

MOST_CONTRAST = 1.5
"""No light makes a photo's detail so much stronger than the scene's; a ghost that the scene has
learned from that photo is so much weaker than what stands there."""


def shared_detail(
    static: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    mask: Bool[Tensor, "H W 1"] | None = None,
) -> Float[Tensor, "rows columns"]:
    """Correlation of the grey of both in the surroundings of each cell of `grid_of`, in [-1, 1].

    Args:
        static: the static scene, colours in [0, 1].
        photo: what it should look like.
        mask: True in the pixels that count, None if all do.
    """
    height, width = photo.shape[:2]
    fine = grid_of(width, height, CELLS)
    both = torch.stack([static.mean(dim=-1), photo.mean(dim=-1)], dim=-1)
    weight = None if mask is None else pooled(mask.to(both), fine)
    grey = _averaged(pooled(both, fine, mask), weight, SMOOTHING)
    s, p = grey
    moments = torch.stack([s, p, s * s, p * p, s * p])
    s, p, ss, pp, sp = _averaged(moments, weight, WINDOW)
    of_static, of_photo = ((ss - s * s).clamp(min=0) + NOISE, (pp - p * p).clamp(min=0) + NOISE)
    common = sp - s * p
    alike = common / (of_static * of_photo).sqrt()
    alike = alike.masked_fill(common / of_static > MOST_CONTRAST, 0.0)
    return pooled(alike[..., None], grid_of(width, height))[0]


def _averaged(
    cells: Float[Tensor, "C rows columns"],
    weight: Float[Tensor, "1 rows columns"] | None,
    size: int,
) -> Float[Tensor, "C rows columns"]:
    """Means over windows of `size` cells, by weight if there is one."""
    if weight is None:
        return window_means(cells, size)
    sums = window_sums(torch.cat([cells * weight, weight]), size)
    return sums[:-1] / sums[-1:].clamp(min=torch.finfo(cells.dtype).tiny)
