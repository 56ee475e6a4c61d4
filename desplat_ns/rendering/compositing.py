"""How layers are put over one another: distractors over the static scene, the background last."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.over import over


def composite_color(
    rgb_d: Float[Tensor, "H W 3"],
    alpha_d: Float[Tensor, "H W 1"],
    rgb_s: Float[Tensor, "H W 3"],
    cut: bool = False,
) -> Float[Tensor, "H W 3"]:
    """Colour of the distractors drawn over the static scene, cut to [0, 1] if asked for.

    Both colours are weighted by their own alpha already; that of the static scene may include what
    lies behind it.
    Source: c = c_d + (1 - alpha_d) c_s, DeSplat, Sec. 3.
    """
    return over(rgb_d, alpha_d, rgb_s, cut)


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
