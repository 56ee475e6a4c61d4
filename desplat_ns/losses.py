"""The terms of Eq. 5 and Eq. 9 to 12, and the price of what no photo needs; how much each counts is
in `image_losses`."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.ssim import compiled_photometric, is_fast, similarities
from desplat_ns.gaussians.activation import sigmoid
from desplat_ns.layers import composite_alpha
from desplat_ns.photo_tourism.camera_response import PRIOR_STD

EXPLAINED_SHARE = 0.6
"""Share of a pixel's 3 x 3 neighbours that the background has to explain. Eq. 9."""

MAX_ERROR = 0.003
"""T_eps of Eq. 10 (colours in [0, 1]): how well the background alone has to explain a pixel for
Gaussians there to be unwanted. B.3."""

RESPONSE_OBSERVATIONS = 1000
"""Independent errors that a training photo counts for beside the prior of its camera's response."""


def photometric_losses(
    photo: Float[Tensor, "H W 3"],
    distractor_weight: Float[Tensor, "H W 1"] | None,
    ssim_weight: float,
    *images: Float[Tensor, "H W 3"],
    leak: float = 0.0,
    compiled: bool = True,
) -> tuple[Float[Tensor, ""], ...]:
    """(1 - w) L1 + w D-SSIM of a photo and each image in [0, 1]; w is `ssim_weight`.

    In L1 of the first image a pixel counts by 1 - (1 - leak) distractor_weight. For its D-SSIM,
    whose windows reach across the border, the photo is blended with the image itself by this
    weight, as a constant.

    Args:
        distractor_weight: of the first image, in [0, 1]; None for 0. That of the second is 0.
        images: one, or two that are equal wherever the distractor weight is 0. On a CPU blocks
            in which they are equal are worked out once, and the second has no gradient there.
        compiled: by numba's kernels where they can; else by torch.

    Source: L_GS, the photometric term of Eq. 5 and 12; `distractor_weight` is ours
    (docs/explain/separation.md).
    """
    if compiled and all(is_fast(image, photo) for image in images):
        return compiled_photometric(photo, distractor_weight, leak, ssim_weight, *images)
    batch, target = torch.stack(images), photo.expand(len(images), *photo.shape)
    difference = (batch - photo).abs()
    if distractor_weight is not None:
        kept = (1 - (1 - leak) * distractor_weight) * difference[:1]
        difference = torch.cat([kept, difference[1:]])
        blended = torch.lerp(photo, images[0].detach(), distractor_weight)
        target = torch.cat([blended[None], target[1:]])
    difference = (1 - ssim_weight) * difference.mean(dim=(1, 2, 3))
    return (difference + ssim_weight * (1 - similarities(batch, target))).unbind()


def distractor_opacity_loss(
    alpha_d: Float[Tensor, "H W 1"], in_region: Float[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean opacity of the distractors, in [0, 1]: a price on what they explain. In pixels where
    `in_region` is 1 instead of 0 their transparency counts.

    Source: Eq. 5, the term weighted by lambda_d; `in_region` is ours
    (docs/explain/separation.md).
    """
    return alpha_d.mean() if in_region is None else F.l1_loss(alpha_d, in_region)


def static_transparency_loss(
    alpha_s: Float[Tensor, "H W 1"], where: Float[Tensor, "H W 1"] | None = None
) -> Float[Tensor, ""]:
    """Mean transparency of the static scene, in [0, 1], a pixel counting by `where`, in [0, 1].

    Source: Eq. 5, the term weighted by lambda_s; `where` is ours.
    """
    if where is None:
        return 1 - alpha_s.sum() / alpha_s.numel()  # its gradient takes no pass over the pixels
    return (where * (1 - alpha_s)).mean()


def mean_shown_opacity(
    opacities: Float[Tensor, "N 1"], visible: Bool[Tensor, " N"]
) -> Float[Tensor, ""]:
    """Mean opacity, in [0, 1], of the Gaussians that a view shows, from logits; 0 where it shows
    none. Those that it does not show stay out: Adam would move what few photos see at every step,
    while the photos speak for it at a few.

    Source: the regularizer of Kheradmand et al. 2024 (Sec. 3.4), which is over all Gaussians.
    """
    shown = visible[:, None].to(opacities)
    return (sigmoid(opacities) * shown).sum() / shown.sum().clamp(min=1)


def camera_response_loss(
    numbers: Float[Tensor, " 5"], mean: Float[Tensor, " 5"], photometric: Float[Tensor, ""]
) -> Float[Tensor, ""]:
    """The prior of the numbers of a `camera_response` about the photos' mean, in units of the
    photometric loss; neither of these gets a gradient.

    Source: negative log likelihoods, Laplace's of the errors and Gauss's of the numbers.
    """
    deviations = (numbers - mean.detach()) / torch.tensor(PRIOR_STD).to(numbers)
    return photometric.detach() * deviations.square().sum() / (2 * RESPONSE_OBSERVATIONS)


@torch.no_grad()
def explained_by_background(
    background: Float[Tensor, "*background 3"],
    photo: Float[Tensor, "H W 3"],
    max_error: float = MAX_ERROR,
) -> Bool[Tensor, "H W 1"]:
    """The set P: pixels with M > 0.6, M being the share of 3 x 3 pixels of small error.

    The error is the mean absolute difference of the channels, colours in [0, 1]. Beyond the image's
    border nothing is explained.

    Source: Eq. 10-11, and P below Eq. 9.
    """
    error = (background - photo).abs().mean(dim=-1)
    small = (error <= max_error).to(photo.dtype)
    share = F.avg_pool2d(small[None, None], 3, 1, 1, count_include_pad=True)
    return share[0, 0, :, :, None] > EXPLAINED_SHARE


def background_opacity_loss(
    alpha_d: Float[Tensor, "H W 1"],
    alpha_s: Float[Tensor, "H W 1"],
    explained: Bool[Tensor, "H W 1"],
) -> Float[Tensor, ""]:
    """L_bg: mean opacity of both sets where the background explains the photo without them; 0 where
    it explains nothing.

    Source: Eq. 9; its sum over P is a mean in the authors' code and in Splatfacto-W, so that its
    weight does not depend on the photo's size.
    """
    alpha = composite_alpha(alpha_d, alpha_s)
    return torch.where(explained, alpha.abs(), 0).sum() / explained.sum().clamp(min=1)
