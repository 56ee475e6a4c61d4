"""The opacity terms of Eq. 5, and a photometric term for the static scene alone.

The photometric term of Eq. 5, (1 - w) L1 + w D-SSIM with w = 0.2, is Splatfacto's and stays there.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.ssim import ssim


def distractor_opacity_loss(
    alpha_d: Float[Tensor, "H W 1"], free: Bool[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean opacity of the distractors, in [0, 1]: what they explain has its price.

    Source: Eq. 5, the term weighted by lambda_d; that opacity costs nothing in the pixels of `free`
    is ours (docs/separation.md).
    """
    return (alpha_d if free is None else alpha_d.masked_fill(free, 0)).mean()


def static_transparency_loss(alpha_s: Float[Tensor, "H W 1"]) -> Float[Tensor, ""]:
    """Mean transparency of the static scene, in [0, 1]: it should fill the image by itself.

    Source: Eq. 5, the term weighted by lambda_s.
    """
    return (1 - alpha_s).mean()


def static_photometric_loss(
    static: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    owned: Float[Tensor, "H W 1"],
    ssim_weight: float,
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w D-SSIM of the static scene alone, as far as distractors do not own a pixel.

    In L1 a pixel counts by 1 - owned. For D-SSIM, whose windows reach across the border, the photo
    is blended with the rendering itself, as a constant: there is nothing to see where it is owned.

    Source: ours (docs/separation.md); the form is the photometric term's of Eq. 5.
    """
    l1 = ((1 - owned) * (static - photo).abs()).mean()
    target = torch.lerp(photo, static.detach(), owned)
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - ssim(static, target))
