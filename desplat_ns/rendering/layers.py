"""The images that come out of the model, made of its layers."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import Rendering
from desplat_ns.rendering.compositing import composite_color, in_range

MASK_THRESHOLD = 0.5
"""A pixel counts as covered where the distractors' opacity is greater. App. C.1."""


def static_outputs(
    static: Rendering, image: Float[Tensor, "H W 3"], background: Float[Tensor, "*background 3"]
) -> dict[str, Tensor]:
    """rgb [H, W, 3] in [0, 1], accumulation [H, W, 1], background, and depth if it was rendered.

    Where nothing is, depth [H, W, 1] (world units) is that of the farthest pixel, as Splatfacto's.

    Args:
        image: the static scene over the background, as the photo shows it; colours beyond 1 are
            cut here.
    """
    outputs = {
        "rgb": in_range(image),
        "accumulation": static.alpha,
        "background": background,
    }
    if static.depth is not None:
        farthest = static.depth.detach().max()
        outputs["depth"] = torch.where(static.alpha > 0, static.depth, farthest)
    return outputs


def layered_outputs(
    image: Float[Tensor, "H W 3"], rgb: Float[Tensor, "H W 3"], distractor: Rendering | None
) -> dict[str, Tensor]:
    """The distractors' layer and the composite, [H, W, C] with colours in [0, 1].

    rgb_composite, distractors over the static scene; rgb_distractor (weighted by its alpha, on
    black); alpha_distractor; distractor_mask (bool). Without distractors (None) their layer is
    empty.

    Args:
        image: as of `static_outputs`.
        rgb: what that gave.
    """
    if distractor is None:
        nothing = rgb.new_zeros(()).expand_as(rgb)  # takes no memory
        composite, rgb_d, alpha_d = rgb, nothing, nothing[..., :1]
    else:
        rgb_d, alpha_d = distractor.rgb, distractor.alpha
        composite = in_range(composite_color(rgb_d, alpha_d, image))
    return {
        "rgb_composite": composite,
        "rgb_distractor": rgb_d,
        "alpha_distractor": alpha_d,
        "distractor_mask": alpha_d > MASK_THRESHOLD,
    }
