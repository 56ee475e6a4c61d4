"""Which Gaussians the first columns of an image are made of; without the rest they are the same.

A Gaussian contributes where its blending weight is above 0. Those that contribute nothing may still
matter: blending stops before the Gaussian that would make a pixel opaque, and without that one it
goes on to the next. Such a pixel's opacity grows, by 1e-4 / 255 at least, which float32 can tell.
So what is left is drawn and compared, and the pixels that differ name what they miss.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.contributions import GEOMETRY
from desplat_ns.backend.protocol import Rasterizer, RenderSettings, Splats, View
from desplat_ns.rendering.in_view import in_view

MAX_ROUNDS = 8
"""Of adding what pixels miss. Three were needed in tests; after these, all in view are taken."""


def rows_of(splats: Splats, rows: Bool[Tensor, " N"]) -> Splats:
    """Only these Gaussians."""
    names = (*GEOMETRY, "colors")
    return replace(splats, **{name: getattr(splats, name)[rows] for name in names})


def needed_by_columns(
    rasterizer: Rasterizer, splats: Splats, view: View, settings: RenderSettings, columns: int
) -> Bool[Tensor, " N"]:
    """The Gaussians without which the first `columns` columns would look different.

    Drawn alone by `numba` they give those columns bit for bit, in whatever colours; other columns
    are wrong. Takes two drawings, and two more for each round of pixels that would go on.

    The `torch` backend sums in batches, whose rounding depends on what else is in a tile: there
    opacities differ everywhere, and these are all Gaussians in view. Alone they give the columns to
    within rounding: how torch rounds a row depends on its place.
    """
    geometry = {name: getattr(splats, name).detach() for name in GEOMETRY}
    white = torch.ones_like(splats.means)
    alone = Splats(**geometry, colors=white)
    draw = _Columns(rasterizer, view, replace(settings, depth=False, absgrad=False), columns)
    seen = in_view(alone, view, settings)
    alpha, weights = draw(alone, seen)
    needed = weights > 0
    for _ in range(MAX_ROUNDS):
        goes_on = draw(alone, needed)[0] != alpha
        if not goes_on.any():
            return needed
        others = seen & ~needed
        missed = draw(alone, others, goes_on)[1] > 0
        if not missed.any():
            break
        needed = needed | missed
    return seen


class _Columns:
    """Draws Gaussians and weighs them in the first columns."""

    def __init__(self, rasterizer: Rasterizer, view: View, settings: RenderSettings, columns: int):
        self.rasterizer, self.view, self.settings = rasterizer, view, settings
        self.columns = columns

    def __call__(
        self, splats: Splats, rows: Bool[Tensor, " N"], pixels: Bool[Tensor, "H W 1"] | None = None
    ) -> tuple[Float[Tensor, "H W 1"], Float[Tensor, " N"]]:
        """The opacity of the columns with these rows only, and each row's sum of weights in them,
        or in `pixels` of them."""
        some = rows_of(splats, rows)
        white = some.colors.requires_grad_()
        with torch.enable_grad():
            drawn = self.rasterizer(some, self.view, self.settings)
            seen = drawn.rgb[:, : self.columns, :1]
            total = seen.sum() if pixels is None else seen[pixels].sum()
            (gradient,) = torch.autograd.grad(total, white)
        weights = torch.zeros_like(splats.opacities)
        weights[rows] = gradient[:, 0]
        return drawn.alpha[:, : self.columns].detach(), weights
