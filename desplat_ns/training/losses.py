"""The terms of Eq. 5: photometric, for an image or for the static scene alone, and of opacities;
and the price of what no photo needs.

In training the photometric term of the composite is Splatfacto's and stays there.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.ssim import ssim


def photometric_loss(
    image: Float[Tensor, "H W 3"], photo: Float[Tensor, "H W 3"], ssim_weight: float
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w D-SSIM of two images in [0, 1]; w is `ssim_weight`.

    Source: L_GS, the photometric term of Eq. 5 and 12.
    """
    return _mixed((image - photo).abs().mean(), ssim(image, photo), ssim_weight)


def _mixed(
    l1: Float[Tensor, ""], similarity: Float[Tensor, ""], ssim_weight: float
) -> Float[Tensor, ""]:
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - similarity)


def distractor_opacity_loss(
    alpha_d: Float[Tensor, "H W 1"], free: Bool[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean opacity of the distractors, in [0, 1]: a price on what they explain.

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
    """(1 - w) L1 + w D-SSIM of the static scene alone, on pixels that distractors do not own.

    In L1 a pixel counts by 1 - owned. For D-SSIM, whose windows reach across the border, the photo
    is blended with the rendering itself, as a constant: there is nothing to see where it is owned.

    Source: ours (docs/separation.md); the form is the photometric term's of Eq. 5.
    """
    l1 = ((1 - owned) * (static - photo).abs()).mean()
    target = torch.lerp(photo, static.detach(), owned)
    return _mixed(l1, ssim(static, target), ssim_weight)


def mean_shown_opacity(
    opacities: Float[Tensor, "N 1"], visible: Bool[Tensor, " N"]
) -> Float[Tensor, ""]:
    """Mean opacity, in [0, 1], of the Gaussians that a view shows; 0 where it shows none.

    Those that it does not show stay out: Adam would move what few photos see at every step, while
    the photos speak for it at a few.

    Args:
        opacities: logits.

    Source: the regularizer of Kheradmand et al. 2024 (Sec. 3.4), which is over all Gaussians.
    """
    shown = visible[:, None].to(opacities)
    return (opacities.sigmoid() * shown).sum() / shown.sum().clamp(min=1)
