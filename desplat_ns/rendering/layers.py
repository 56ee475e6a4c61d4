"""The images that come out of the model, made of its layers."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import Rendering
from desplat_ns.rendering.compositing import composite_alpha, composite_color, over_background

MASK_THRESHOLD = 0.5
"""A pixel counts as covered where the distractors' opacity is greater. App. C.1."""


def static_outputs(
    static: Rendering, background: Float[Tensor, "*background 3"]
) -> dict[str, Tensor]:
    """rgb [H, W, 3] in [0, 1], accumulation [H, W, 1], background, and depth if it was rendered.

    Where nothing is, depth [H, W, 1] (world units) is that of the farthest pixel, as Splatfacto's.
    """
    outputs = {
        "rgb": over_background(static.rgb, static.alpha, background).clamp(0, 1),
        "accumulation": static.alpha,
        "background": background,
    }
    if static.depth is not None:
        farthest = static.depth.detach().max()
        outputs["depth"] = torch.where(static.alpha > 0, static.depth, farthest)
    return outputs


def layered_outputs(
    static: Rendering,
    distractor: Rendering | None,
    background: Float[Tensor, "*background 3"],
) -> dict[str, Tensor]:
    """The distractors' layer and the composite, [H, W, C] with colours in [0, 1].

    rgb_composite, distractors over the static scene over the background; rgb_distractor (weighted
    by its alpha, on black); alpha_distractor; distractor_mask (bool). Without distractors (None)
    their layer is empty.
    """
    alpha_s = static.alpha
    rgb_d = torch.zeros_like(static.rgb) if distractor is None else distractor.rgb
    alpha_d = torch.zeros_like(alpha_s) if distractor is None else distractor.alpha
    both = composite_color(rgb_d, alpha_d, static.rgb)
    composite = over_background(both, composite_alpha(alpha_d, alpha_s), background)
    return {
        "rgb_composite": composite.clamp(0, 1),
        "rgb_distractor": rgb_d,
        "alpha_distractor": alpha_d,
        "distractor_mask": alpha_d > MASK_THRESHOLD,
    }
