"""SSIM and the photometric loss of training: pytorch_msssim's value and gradient, at a tenth of its
cost on a CPU."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
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
        (loss,) = _Photometric.apply(target, None, 0.0, 1.0, pred)
        return 1 - loss
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
    (docs/results/separation.md).
    """
    if all(_is_fast(image, photo) for image in images):
        return _Photometric.apply(photo, owned, leak, ssim_weight, *images)  # type: ignore[no-any-return]
    differences, targets = [(image - photo).abs() for image in images], [photo for _ in images]
    if owned is not None:
        differences[0] = (1 - (1 - leak) * owned) * differences[0]
        targets[0] = torch.lerp(photo, images[0].detach(), owned)
    similarities = _similarities(images, targets)
    pairs = zip(differences, similarities, strict=True)
    return tuple((1 - ssim_weight) * d.mean() + ssim_weight * (1 - s) for d, s in pairs)


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


class _Photometric(torch.autograd.Function):
    """The gradient is worked out with the value: the two share most of the work."""

    @staticmethod
    def forward(ctx, photo, owned, leak, ssim_weight, first, second=None):  # type: ignore[override]
        sums = _Sums(first, ssim_weight, leak)
        gradients = [sums.differentiate(first, photo, owned)]
        losses = [sums.loss()]
        if second is not None:
            wanted = None if owned is None else sums.blocks_of(owned)
            gradients.append(sums.differentiate(second, photo, None, wanted))
            losses.append(sums.loss())
        ctx.save_for_backward(*gradients)
        return tuple(losses)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):  # type: ignore[override]
        by_image = zip(grads, ctx.saved_tensors, strict=True)
        scaled = (saved if grad == 1 else grad * saved for grad, saved in by_image)
        return None, None, None, None, *scaled


class _Sums:
    """SSIM and L1 of an image, summed over the kernels' blocks."""

    def __init__(self, image: Float[Tensor, "H W 3"], ssim_weight: float, leak: float):
        from desplat_ns.backend.numba_kernels import ssim as kernels  # numba is large

        self.shape = height, length = image.shape[0], image.shape[1] * kernels.CHANNELS
        self.kernels = kernels
        down, across = -(-height // kernels.ROWS), -(-length // kernels.COLUMNS)
        self.similarity, self.difference = np.empty((down, across)), np.empty((down, across))
        windows = (height - kernels.MARGIN) * (length - kernels.SIDE)
        self.per_window = ssim_weight / windows
        self.per_number = (1 - ssim_weight) / (height * length)
        self.constant, self.kept = ssim_weight, np.float32(1 - leak)

    def blocks_of(self, owned: Float[Tensor, "H W 1"]) -> np.ndarray:
        """Blocks of pixels [down, across] in which anything is owned."""
        pixels, height = owned[..., 0].numpy(), self.kernels.ROWS
        rows = [pixels[row : row + height].max(axis=0) for row in range(0, len(pixels), height)]
        columns = np.arange(self.difference.shape[1]) * (
            self.kernels.COLUMNS // self.kernels.CHANNELS
        )
        return (np.maximum.reduceat(np.stack(rows), columns, axis=1) > 0).astype(np.uint8)

    def differentiate(
        self, image: Tensor, photo: Tensor, owned: Tensor | None, wanted: np.ndarray | None = None
    ) -> Tensor:
        """Take up the sums of an image, where they are wanted, and give the gradient of `loss`."""
        from desplat_ns.backend.numba_kernels.runtime import (
            flat,
            launching,
            new_counter,
            num_workers,
        )

        if wanted is None:
            wanted = np.empty((0, 0), np.uint8)
        weights = np.empty(0, np.float32) if owned is None else flat(owned)
        rates = self.kept, np.float32(-self.per_window), np.float32(self.per_number)
        images, sums = (flat(image), flat(photo), weights), (self.similarity, self.difference)
        gradient = torch.empty(image.shape)
        with launching():
            self.kernels.score_image(
                *(images, self.shape, wanted, rates, sums, flat(gradient)),
                *(new_counter(), num_workers()),
            )
        return gradient

    def loss(self) -> Float[Tensor, ""]:
        """(1 - w) L1 + w (1 - SSIM)."""
        similarity, difference = float(self.similarity.sum()), float(self.difference.sum())
        value = self.constant - self.per_window * similarity + self.per_number * difference
        return torch.tensor(value)
