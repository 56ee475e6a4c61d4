"""SSIM as a training loss: pytorch_msssim's value and gradient, at a tenth of its cost on a CPU."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
import torch
from jaxtyping import Float
from pytorch_msssim import ssim as msssim_ssim
from pytorch_msssim.ssim import _fspecial_gauss_1d as gaussian_window
from torch import Tensor


@cache
def _kernels() -> ModuleType | None:
    """The compiled kernels, imported when the first image is scored: numba is large.

    None where numba is missing: `ssim` is slower then, not wrong.
    """
    try:
        from desplat_ns.backend.numba_kernels import ssim as kernels
    except ImportError:
        return None
    return kernels


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
        return _Ssim.apply(pred, target)  # type: ignore[no-any-return]
    planes = (image.movedim(-1, 0)[None] for image in (pred, target))
    return msssim_ssim(*planes, data_range=1.0, win=_window(pred.shape[2], pred.dtype, pred.device))


@cache
def _window(channels: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """pytorch_msssim's default window [C, 1, 1, 11]. It would be sent to a GPU by every call."""
    return gaussian_window(11, 1.5).repeat(channels, 1, 1, 1).to(device, dtype)


def ssim_of_planes(
    target: Float[Tensor, "1 C H W"], pred: Float[Tensor, "1 C H W"]
) -> Float[Tensor, ""]:
    """`ssim` as Splatfacto calls it: photo first, channels first."""
    return ssim(pred[0].movedim(0, -1), target[0].movedim(0, -1))


def _is_fast(pred: Tensor, target: Tensor) -> bool:
    if any(t.device.type != "cpu" or t.dtype != torch.float32 for t in (pred, target)):
        return False
    kernels = _kernels()
    return (
        kernels is not None
        and pred.shape[2] == kernels.CHANNELS
        and min(pred.shape[:2]) >= kernels.WINDOW
        and not (target.requires_grad and torch.is_grad_enabled())
    )


class _Ssim(torch.autograd.Function):
    """The gradient is worked out with the value: the two share most of the work."""

    @staticmethod
    def forward(ctx, pred, target):  # type: ignore[override]
        value, gradient = _score(pred, target, ctx.needs_input_grad[0])
        if gradient is not None:
            ctx.save_for_backward(gradient)
        return value

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        return grad * ctx.saved_tensors[0], None


def _score(pred: Tensor, target: Tensor, with_gradient: bool) -> tuple[Tensor, Tensor | None]:
    """Mean SSIM and, if asked for, its gradient by `pred`."""
    from desplat_ns.backend.numba_kernels import ssim as kernels
    from desplat_ns.backend.numba_kernels.runtime import flat, launching, new_counter, num_workers

    height, length = pred.shape[0], pred.shape[1] * kernels.CHANNELS
    out_rows, out_columns = height - kernels.MARGIN, length - kernels.SIDE
    x, y = flat(pred), flat(target)
    blocks = (-(-out_rows // kernels.ROWS), -(-out_columns // kernels.COLUMNS))
    sums, count = np.empty(blocks), out_rows * out_columns
    padded = 3 * (height + kernels.MARGIN) * (length + kernels.SIDE)
    slopes = np.empty(padded if with_gradient else 0, np.float32)
    size, workers = (height, length), num_workers()
    with launching():
        kernels.score_image(x, y, *size, slopes, sums, new_counter(), workers)
        value = torch.tensor(float(sums.sum()) / count)
        if not with_gradient:
            return value, None
        gradient = torch.empty(pred.shape)
        scale, counter = np.float32(1 / count), new_counter()
        out = gradient.view(-1).numpy()
        kernels.backward_image(x, y, *size, slopes, scale, out, counter, workers)
    return value, gradient
