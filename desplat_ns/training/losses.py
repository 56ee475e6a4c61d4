"""The terms of Eq. 5: photometric, for an image or for the static scene alone, and of opacities;
and the price of what no photo needs.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.ssim import photometric_losses


def photometric_loss(
    image: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    ssim_weight: float,
    owned: Float[Tensor, "H W 1"] | None = None,
    leak: float = 0.0,
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w D-SSIM of two images in [0, 1]; w is `ssim_weight`.

    With `owned` on the pixels that distractors do not own: in L1 a pixel counts by
    1 - (1 - leak) owned. For D-SSIM, whose windows reach across the border, the photo is blended
    with the rendering itself, as a constant: there is nothing to see where it is owned.

    Source: L_GS, the photometric term of Eq. 5 and 12; `owned` is ours
    (docs/results/separation.md).
    """
    return photometric_losses(photo, owned, ssim_weight, image, leak=leak)[0]


def layered_photometric_losses(
    static: Float[Tensor, "H W 3"],
    composite: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    ssim_weight: float,
    owned: Float[Tensor, "H W 1"],
    leak: float = 0.0,
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """`photometric_loss` of the static scene on what distractors do not own, and of the composite.

    Args:
        composite: equals `static` where nothing is owned. For what it is made of has no gradient
            there either, most of the second term is the first one's: on a CPU it is taken from it.
    """
    own, main = photometric_losses(photo, owned, ssim_weight, static, composite, leak=leak)
    return own, main


def distractor_opacity_loss(
    alpha_d: Float[Tensor, "H W 1"], free: Float[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean opacity of the distractors, in [0, 1]: a price on what they explain.

    Args:
        free: 1 in pixels where opacity costs nothing, 0 in others.

    Source: Eq. 5, the term weighted by lambda_d; `free` is ours (docs/results/separation.md).
    """
    if free is None:
        return alpha_d.mean()
    return torch.dot(alpha_d.flatten(), (1 - free).flatten()) / alpha_d.numel()


def static_transparency_loss(
    alpha_s: Float[Tensor, "H W 1"], where: Float[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean transparency of the static scene, in [0, 1]: it should fill the image by itself.

    Args:
        where: how much each pixel counts, in [0, 1]; None where all of them do.

    Source: Eq. 5, the term weighted by lambda_s; `where` is ours.
    """
    if where is None:
        return 1 - alpha_s.sum() / alpha_s.numel()  # its gradient takes no pass over the pixels
    return (where * (1 - alpha_s)).mean()


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
