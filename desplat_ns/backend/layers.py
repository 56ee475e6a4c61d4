"""One layer over another in one pass on a CPU: torch takes six times as long with the gradients."""

from __future__ import annotations

import numpy as np
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


class _Over(torch.autograd.Function):
    @staticmethod
    def forward(ctx, front, alpha, behind, is_cut):  # type: ignore[override]
        from desplat_ns.backend.numba_kernels import layers as kernels
        from desplat_ns.backend.numba_kernels.runtime import flat, launching, new_counter
        from desplat_ns.backend.numba_kernels.runtime import num_workers as workers

        out = torch.empty(front.shape)
        images = (flat(front), flat(alpha), flat(behind))
        with launching():
            kernels.over_image(*images, is_cut, flat(out), new_counter(), workers())
        ctx.save_for_backward(front, alpha, behind)
        ctx.is_cut = is_cut
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        from desplat_ns.backend.numba_kernels import layers as kernels
        from desplat_ns.backend.numba_kernels.runtime import flat, launching, new_counter
        from desplat_ns.backend.numba_kernels.runtime import num_workers as workers

        saved = [flat(tensor) for tensor in ctx.saved_tensors]
        by_front, by_alpha, by_behind = (torch.empty(t.shape) for t in ctx.saved_tensors)
        last = flat(by_behind) if ctx.needs_input_grad[2] else np.empty(0, np.float32)
        given = (flat(grad), flat(by_front), flat(by_alpha), last)
        with launching():
            kernels.over_image_backward(*saved, ctx.is_cut, *given, new_counter(), workers())
        return by_front, by_alpha, by_behind if ctx.needs_input_grad[2] else None, None
