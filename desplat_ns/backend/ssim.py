"""SSIM and the photometric loss of training: pytorch_msssim's value and gradient, at a tenth of its
cost on a CPU."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import torch
from jaxtyping import Float
from pytorch_msssim import ssim as msssim_ssim
from pytorch_msssim.ssim import _fspecial_gauss_1d as gaussian_window
from torch import Tensor

WINDOW = 11
"""Pixels across the Gaussian window."""


def ssim(pred: Float[Tensor, "H W C"], target: Float[Tensor, "H W C"]) -> Float[Tensor, ""]:
    """Mean structural similarity of two images in [0, 1], over channels and full 11 x 11 windows.

    In [-1, 1], 1 if they are equal. Float32 RGB on the CPU takes the compiled kernels, everything
    else pytorch_msssim. The fast way has no gradient for `target`, so a target that needs one goes
    the slow way too.

    Source: Wang et al. 2004, Eq. 13; Gaussian window, sigma 1.5, K1 = 0.01, K2 = 0.03.
    """
    if pred.shape != target.shape:
        raise ValueError(f"pred has shape {tuple(pred.shape)}, target {tuple(target.shape)}.")
    if _is_fast(pred, target):
        return 1 - _compiled(target, None, 0.0, 1.0, pred)[0]
    return _similarities([pred], [target])[0]


def photometric_losses(
    photo: Float[Tensor, "H W 3"],
    owned: Float[Tensor, "H W 1"] | None,
    ssim_weight: float,
    *images: Float[Tensor, "H W 3"],
    leak: float = 0.0,
) -> tuple[Float[Tensor, ""], ...]:
    """(1 - w) L1 + w D-SSIM of a photo and each image in [0, 1]; w is `ssim_weight`.

    In L1 of the first image a pixel counts by 1 - (1 - leak) owned. For its D-SSIM, whose windows
    reach across the border, the photo is blended with the image itself, as a constant: there is
    nothing to see where it is owned.

    Args:
        owned: by distractors, in the first image; None for nothing. In the second nothing is.
        leak: weight in L1 of what they own wholly.
        images: one, or two that are equal in all pixels of which nothing is owned. On a CPU blocks
            in which they are equal are worked out once, and the second has no gradient there.

    Source: L_GS, the photometric term of Eq. 5 and 12; `owned` is ours
    (docs/explain/separation.md).
    """
    if all(_is_fast(image, photo) for image in images):
        return _compiled(photo, owned, leak, ssim_weight, *images)
    differences, targets = [(image - photo).abs() for image in images], [photo for _ in images]
    if owned is not None:
        differences[0] = (1 - (1 - leak) * owned) * differences[0]
        targets[0] = torch.lerp(photo, images[0].detach(), owned)
    similarities = _similarities(images, targets)
    pairs = zip(differences, similarities, strict=True)
    return tuple((1 - ssim_weight) * d.mean() + ssim_weight * (1 - s) for d, s in pairs)


def _compiled(*arguments: Any) -> tuple[Float[Tensor, ""], ...]:
    from desplat_ns.backend.numba_kernels.ssim import Photometric  # numba is large

    return Photometric.apply(*arguments)  # type: ignore[no-any-return]


def _similarities(
    images: Sequence[Float[Tensor, "H W C"]], targets: Sequence[Float[Tensor, "H W C"]]
) -> Float[Tensor, " B"]:
    """SSIM of each image and its target, all in one batch, by pytorch_msssim."""
    x, y = (torch.stack([image.movedim(-1, 0) for image in batch]) for batch in (images, targets))
    window = _window(x.shape[1], x.dtype, x.device)
    return msssim_ssim(x, y, data_range=1.0, size_average=False, win=window)


@cache
def _window(channels: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """pytorch_msssim's default window [C, 1, 1, 11]. It would be sent to a GPU by every call."""
    return gaussian_window(WINDOW, 1.5).repeat(channels, 1, 1, 1).to(device, dtype)


def _is_fast(image: Tensor, target: Tensor) -> bool:
    """Whether the compiled kernels can work it out."""
    is_float32 = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in (image, target))
    is_fixed = not (target.requires_grad and torch.is_grad_enabled())
    return is_float32 and is_fixed and image.shape[2] == 3 and min(image.shape[:2]) >= WINDOW
