"""SSIM of the photometric loss: pytorch_msssim's value and gradient, at a tenth of its cost on a
CPU where the compiled kernels can work it out, and of fewer operations elsewhere.

Source: Wang et al. 2004, Eq. 13; Gaussian window, sigma 1.5, K1 = 0.01, K2 = 0.03.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float
from pytorch_msssim.ssim import _fspecial_gauss_1d as gaussian_window
from torch import Tensor

try:  # docs/install.md says how to get it
    from fused_ssim import fused_ssim  # pyright: ignore[reportMissingImports]
except ImportError:
    fused_ssim = None

WINDOW = 11
"""Pixels across the Gaussian window."""

MARGIN = WINDOW - 1
"""Pixels that the window needs beyond those it yields."""

C1, C2 = 0.01**2, 0.03**2
"""Stabilizers for images in [0, 1]."""


def compiled_photometric(*arguments: Any) -> tuple[Float[Tensor, ""], ...]:
    """`losses.photometric_losses` by the kernels, where `is_fast`."""
    from desplat_ns.backend.numba_kernels.ssim import Photometric  # numba is large

    return Photometric.apply(*arguments)  # type: ignore[no-any-return]


def similarities(
    images: Float[Tensor, "B H W C"], targets: Float[Tensor, "B H W C"]
) -> Float[Tensor, " B"]:
    """SSIM of each image and its target, a constant: on a GPU by fused-ssim where it is installed.
    A side shorter than the window is not blurred, as in pytorch_msssim."""
    x, y = images.movedim(-1, 1), targets.movedim(-1, 1)
    is_float32 = x.is_cuda and x.dtype == torch.float32
    if fused_ssim is None or not is_float32 or min(x.shape[2:]) < WINDOW:
        return _Ssim.apply(x, y)  # type: ignore[return-value]
    pairs = zip(x.contiguous().split(1), y.contiguous().split(1), strict=True)
    return torch.stack([fused_ssim(*pair, padding="valid") for pair in pairs])


class _Ssim(torch.autograd.Function):
    """Of images and targets [B, C, H, W]; half of the operations that autograd takes. Formulas and
    letters (l, s; P, -Q, R) are those of `numba_kernels/ssim.py`, of SSIM / 4."""

    @staticmethod
    def forward(ctx, x, y):  # type: ignore[override]
        moments = _blurred(torch.cat([x, y, torch.addcmul(x * x, y, y), x * y], dim=1))
        mx, my, squares, product = moments.chunk(4, dim=1)
        means, means2 = mx * my, torch.addcmul(mx * mx, my, my)
        top_l, top_s = means + C1 / 2, product - means + C2 / 2
        low_l, low_s = means2 + C1, squares - means2 + C2
        low = low_l * low_s
        ssim = top_l * top_s / low
        if ctx.needs_input_grad[0]:
            p = torch.addcmul(my * (top_s - top_l), mx * ssim, low_s - low_l, value=-2) / low
            ctx.save_for_backward(x, y, torch.cat([p, ssim / low_s, top_l / low], dim=1))
        ctx.factor = 4 / ssim[0].numel()
        return 4 * ssim.mean(dim=(1, 2, 3))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        x, y, slopes = ctx.saved_tensors
        p, q, r = _blurred(slopes, MARGIN, x.shape).chunk(3, dim=1)
        slope = torch.addcmul(torch.addcmul(p, y, r), x, q, value=-2)
        return (ctx.factor * grad)[:, None, None, None] * slope, None


def _blurred(planes: Tensor, margin: int = 0, of: Sequence[int] | None = None) -> Tensor:
    """Planes [B, C, H, W] blurred where the window fits, over a border of zeros with a margin.
    `of`: shape by which it fits; that of the planes if None."""
    for side in (-2, -1):
        if (of or planes.shape)[side] >= WINDOW:
            window = _window(planes.shape[1], side, planes.dtype, planes.device)
            padding = (margin, 0) if side == -2 else (0, margin)
            planes = F.conv2d(planes, window, padding=padding, groups=planes.shape[1])
    return planes


@cache
def _window(channels: int, side: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """pytorch_msssim's Gaussian along a side: [C, 1, 11, 1], or [C, 1, 1, 11] for the last."""
    window = gaussian_window(WINDOW, 1.5).repeat(channels, 1, 1, 1)
    return window.transpose(side, -1).to(device, dtype)


def is_fast(image: Tensor, target: Tensor) -> bool:
    """Whether the compiled kernels can work it out."""
    is_float32 = all(t.is_cpu and t.dtype == torch.float32 for t in (image, target))
    return is_float32 and image.shape[2] == 3 and min(image.shape[:2]) >= WINDOW
