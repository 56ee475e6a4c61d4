"""A layer over what lies behind it: compiled on a CPU, where it is most of what an image costs
besides blending and scoring it."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import torch
from jaxtyping import Float
from torch import Tensor


@cache
def _kernels() -> ModuleType | None:
    """The compiled kernels, imported when the first layer is drawn: numba is large. None where it
    is missing."""
    try:
        from desplat_ns.backend.numba_kernels import over as kernels
    except ImportError:
        return None
    return kernels


def over(
    top: Float[Tensor, "H W C"],
    alpha: Float[Tensor, "H W 1"],
    below: Float[Tensor, "*below C"],
    cut: bool = False,
) -> Float[Tensor, "H W C"]:
    """top + (1 - alpha) below: a layer that is weighted by its alpha already, over one colour [C]
    or an image [H, W, C].

    Float32 RGB on the CPU takes the compiled kernels, to the same bits; of gradients only the sum
    over the colours may be rounded otherwise.

    Args:
        cut: whether the colours are `in_range`.

    Source: alpha blending.
    """
    if _is_fast(top, alpha, below):
        return _Over.apply(top, alpha, below, cut)  # type: ignore[no-any-return]
    image = top + (1 - alpha) * below
    return in_range(image) if cut else image


def in_range(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W C"]:
    """Colours clamped to [0, 1], with the bits of `torch.clamp` (2.15), whose gradient takes
    several passes over them: it is 1 within the range, 0 on its border and beyond, and for NaN."""
    return _InRange.apply(image) if _are_compiled_for(image) else image.clamp(0, 1)  # type: ignore[no-any-return]


def _is_fast(top: Tensor, alpha: Tensor, below: Tensor) -> bool:
    if (below.ndim == 1 and below.requires_grad) or (below.ndim > 1 and below.shape != top.shape):
        return False
    fits = top.ndim == 3 and top.shape == (*alpha.shape[:2], 3)
    return fits and _are_compiled_for(top, alpha, below)


def _are_compiled_for(*tensors: Tensor) -> bool:
    is_cpu = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in tensors)
    return is_cpu and _kernels() is not None


def _launch(kernel: str, *values: Tensor | bool) -> None:
    """Call one of the kernels, with flat arrays; those that it writes into are contiguous."""
    from desplat_ns.backend.numba_kernels.runtime import flat, launching, new_counter, num_workers

    arrays = (flat(value) if isinstance(value, Tensor) else value for value in values)
    with launching():
        getattr(_kernels(), kernel)(*arrays, new_counter(), num_workers())


class _Over(torch.autograd.Function):
    """See `numba_kernels/over.py`."""

    @staticmethod
    def forward(ctx, top, alpha, below, cut):  # type: ignore[override]
        out = torch.empty(top.shape)
        _launch("put_over", top, alpha, below, out, cut)
        ctx.save_for_backward(top if cut else out.new_empty(0), alpha, below)
        ctx.cut = cut
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        top, alpha, below = ctx.saved_tensors
        by_top, by_alpha = torch.empty(top.shape), torch.empty(alpha.shape)
        by_below = torch.empty(below.shape if ctx.needs_input_grad[2] else 0)
        _launch("pull_under", grad, top, alpha, below, by_top, by_alpha, by_below)
        by_below = by_below if ctx.needs_input_grad[2] else None
        return by_top if ctx.cut else grad, by_alpha, by_below, None


class _InRange(torch.autograd.Function):
    """See `in_range`."""

    @staticmethod
    def forward(ctx, image):  # type: ignore[override]
        ctx.save_for_backward(image)
        return image.clamp(0, 1)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        by_image = torch.empty(grad.shape)
        _launch("pull_within", grad, *ctx.saved_tensors, by_image)
        return by_image
