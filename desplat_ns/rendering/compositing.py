"""How layers are put over one another: distractors over the static scene, the background last."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.over import over


def composite_color(
    rgb_d: Float[Tensor, "H W 3"],
    alpha_d: Float[Tensor, "H W 1"],
    rgb_s: Float[Tensor, "H W 3"],
) -> Float[Tensor, "H W 3"]:
    """Colour of the distractors drawn over the static scene.

    Both colours are weighted by their own alpha already; that of the static scene may include what
    lies behind it.
    Source: c = c_d + (1 - alpha_d) c_s, DeSplat, Sec. 3.
    """
    return over(rgb_d, alpha_d, rgb_s)


def composite_alpha(
    alpha_d: Float[Tensor, "H W 1"], alpha_s: Float[Tensor, "H W 1"]
) -> Float[Tensor, "H W 1"]:
    """Opacity of the distractors drawn over the static scene, in [0, 1].

    Source: the summand of Eq. 9.
    """
    return alpha_d + (1 - alpha_d) * alpha_s


def over_background(
    rgb: Float[Tensor, "H W 3"],
    alpha: Float[Tensor, "H W 1"],
    background: Float[Tensor, "*background 3"],
) -> Float[Tensor, "H W 3"]:
    """A layer, weighted by its alpha already, over a background of one colour or one per pixel.

    Source: alpha blending; with `composite_alpha` the background's weight is
    (1 - alpha_d) (1 - alpha_s), DeSplat, Sec. 3.
    """
    return over(rgb, alpha, background)


def in_range(image: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W 3"]:
    """Colours clamped to [0, 1], with the bits of `torch.clamp` (2.15), whose gradient takes six
    passes over them."""
    return _InRange.apply(image)  # type: ignore[no-any-return]


class _InRange(torch.autograd.Function):
    """The gradient is 1 within the range, 0 on its border and beyond, and where a colour is NaN."""

    @staticmethod
    def forward(ctx, image):  # type: ignore[override]
        clamped = image.clamp(0, 1)
        ctx.save_for_backward((image > 0) & (image < 1))
        return clamped

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        return torch.where(ctx.saved_tensors[0], grad, 0.0)
