"""SSIM of the photometric loss: pytorch_msssim's value and gradient, at a tenth of its cost on a
CPU where the compiled kernels can work it out.

Source: Wang et al. 2004, Eq. 13; Gaussian window, sigma 1.5, K1 = 0.01, K2 = 0.03.
"""

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


def compiled_photometric(*arguments: Any) -> tuple[Float[Tensor, ""], ...]:
    """`losses.photometric_losses` by the kernels, where `is_fast`."""
    from desplat_ns.backend.numba_kernels.ssim import Photometric  # numba is large

    return Photometric.apply(*arguments)  # type: ignore[no-any-return]


def similarities(
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


def is_fast(image: Tensor, target: Tensor) -> bool:
    """Whether the compiled kernels can work it out."""
    is_float32 = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in (image, target))
    is_fixed = not (target.requires_grad and torch.is_grad_enabled())
    return is_float32 and is_fixed and image.shape[2] == 3 and min(image.shape[:2]) >= WINDOW
