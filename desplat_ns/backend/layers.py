"""One layer over another in one pass on a CPU: torch takes six times as long with the gradients."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.ssim import has_kernels


def compiled_over(
    front: Float[Tensor, "H W 3"],
    alpha: Float[Tensor, "H W 1"],
    behind: Float[Tensor, "*behind 3"],
    is_cut: bool,
) -> Float[Tensor, "H W 3"] | None:
    """front + (1 - alpha) behind, cut to [0, 1] if `is_cut`; None where the kernels cannot.

    They take float32 on the CPU, and what lies behind as an image, or as one colour that needs no
    gradient.
    """
    layers = (front, alpha, behind)
    is_image = behind.shape == front.shape
    if any(t.device.type != "cpu" or t.dtype != torch.float32 for t in layers):
        return None
    if not has_kernels() or not (is_image or (behind.numel() == 3 and not behind.requires_grad)):
        return None
    return _Over.apply(*layers, is_cut)  # type: ignore[no-any-return]


def _launch(kernel: str, *arguments: Any) -> None:
    """Call one of the kernels; tensors go to it as flat arrays."""
    from desplat_ns.backend.numba_kernels import layers as kernels
    from desplat_ns.backend.numba_kernels.runtime import flat, launching, new_counter, num_workers

    given = [flat(a) if isinstance(a, Tensor) else a for a in arguments]
    with launching():
        getattr(kernels, kernel)(*given, new_counter(), num_workers())


class _Over(torch.autograd.Function):
    @staticmethod
    def forward(ctx, front, alpha, behind, is_cut):  # type: ignore[override]
        out = torch.empty(front.shape)
        _launch("over_image", front, alpha, behind, is_cut, out)
        ctx.save_for_backward(front, alpha, behind)
        ctx.is_cut = is_cut
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        front, alpha, behind = ctx.saved_tensors
        by_front, by_alpha = torch.empty(front.shape), torch.empty(alpha.shape)
        by_behind = torch.empty(behind.shape if ctx.needs_input_grad[2] else 0)
        given = (*ctx.saved_tensors, ctx.is_cut, grad)
        _launch("over_image_backward", *given, by_front, by_alpha, by_behind)
        return by_front, by_alpha, by_behind if ctx.needs_input_grad[2] else None, None
