"""A small network over many rows, forward and backward by blocks that stay in the cache.

    h_0 = x,    h_l = max(W_l h_(l-1) + b_l, 0),    out = W_L h_(L-1) + b_L

A column of h belongs to a row of the input: a matrix product is fast where its last dimension is
long, and six outputs or 27 inputs are not. The hidden layers are kept for the backward pass in
memory that is used again, for fresh memory has to be mapped, page by page, which took as long as a
third of the forward pass.

The blocks follow each other in one order, so that sums have the same bits every time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

COLUMNS = {torch.float32: 512, torch.float64: 256, torch.bfloat16: 2048}
"""Rows that pass through the network together on a CPU, by the dtype of the products: the fastest
of 256 to 8,192 for layers of 128 units, 1 MiB of cache. A GPU takes all together."""


@dataclass(frozen=True)
class Layers:
    """A network's layers, from input to output; a ReLU after each but the last."""

    weights: Sequence[Tensor]
    """[outputs, inputs] each."""
    biases: Sequence[Tensor]
    """[outputs] each."""

    def detached(self) -> Layers:
        """The same network, without gradients."""
        return Layers([w.detach() for w in self.weights], [b.detach() for b in self.biases])


def mlp_of_rows(
    parts: Sequence[Float[Tensor, "N _"]],
    layers: Layers,
    rows: Int[Tensor, " R"] | None = None,
    dtype: torch.dtype | None = None,
) -> Shaped[Tensor, "N outputs"]:
    """The network's outputs for inputs whose columns are those of `parts`, side by side.

    Args:
        parts: inputs, one dtype.
        rows: which of the N rows to work out, each at most once; all others are 0 and pass no
            gradient on. All if None.
        dtype: of the products and of what is between the layers; sums over blocks, outputs and
            gradients are of the inputs' dtype, which is the default.
    """
    job = _Job(rows, dtype or parts[0].dtype, len(parts))
    return _Mlp.apply(job, *parts, *layers.weights, *layers.biases)  # type: ignore[return-value]


@dataclass(frozen=True)
class _Job:
    """What `_Mlp` needs beside tensors that have gradients."""

    rows: Tensor | None
    dtype: torch.dtype
    num_parts: int

    def split(self, tensors: Sequence[Any]) -> tuple[list[Any], list[Any], list[Any]]:
        """Parts, weights, biases."""
        depth = (len(tensors) - self.num_parts) // 2
        first, second = self.num_parts, self.num_parts + depth
        return list(tensors[:first]), list(tensors[first:second]), list(tensors[second:])

    def blocks(self, parts: list[Tensor]) -> list[Tensor | slice]:
        """Rows that are worked on together."""
        count = len(parts[0]) if self.rows is None else len(self.rows)
        at_once = COLUMNS.get(self.dtype, 512) if parts[0].device.type == "cpu" else max(count, 1)
        starts = range(0, count, at_once)
        if self.rows is None:
            return [slice(i, min(i + at_once, count)) for i in starts]
        return [self.rows[i : i + at_once] for i in starts]


class _Workspace:
    """Memory for hidden layers: given out, and taken back when the backward pass is through."""

    def __init__(self) -> None:
        self._free: list[Tensor] = []

    def take(self, size: int, like: Tensor, dtype: torch.dtype) -> Tensor:
        """A flat tensor of `size` numbers at least, of any value, on the device of `like`."""
        try:
            found = self._free.pop()
        except IndexError:
            found = like.new_empty(0)
        fits = found.dtype == dtype and found.device == like.device and len(found) >= size
        return found if fits else like.new_empty(size + size // 8, dtype=dtype)

    def give_back(self, memory: Tensor) -> None:
        """Keep one for the next step, on a CPU; a GPU's allocator does so itself."""
        if memory.device.type == "cpu":
            self._free[:] = [memory]


_workspace = _Workspace()


class _Mlp(torch.autograd.Function):
    """(job, parts, weights, biases) -> outputs [N, outputs]."""

    @staticmethod
    def forward(ctx: Any, job: _Job, *tensors: Tensor) -> Tensor:  # type: ignore[override]
        parts, weights, biases = job.split(tensors)
        out = _new(parts[0], len(weights[-1]), job.rows is None)
        is_kept = any(ctx.needs_input_grad)
        hidden = _run(job, parts, weights, biases, out, is_kept)
        ctx.job, ctx.hidden = job, hidden
        ctx.save_for_backward(*tensors)
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        job, tensors = ctx.job, ctx.saved_tensors
        hidden, ctx.hidden = ctx.hidden, None
        if hidden is None:  # a second backward pass through the same graph
            parts, weights, biases = job.split(tensors)
            out = _new(parts[0], len(weights[-1]), True)
            hidden = _run(job, parts, weights, biases, out, True)
        assert hidden is not None
        gradients = _pull(job, tensors, ctx.needs_input_grad[1:], hidden, grad)
        _workspace.give_back(hidden)
        return None, *gradients


def _new(like: Tensor, width: int, is_filled_later: bool) -> Tensor:
    make = torch.empty if is_filled_later else torch.zeros
    return make(len(like), width, dtype=like.dtype, device=like.device)


def _run(
    job: _Job,
    parts: list[Tensor],
    weights: list[Tensor],
    biases: list[Tensor],
    out: Tensor,
    is_kept: bool,
) -> Tensor | None:
    """Fill `out`; give the hidden layers of all blocks if they are to be kept."""
    w, b = [x.to(job.dtype) for x in weights], [x.to(job.dtype)[:, None] for x in biases]
    widths, blocks = [len(x) for x in w[:-1]], job.blocks(parts)
    sizes = [_count(block) for block in blocks]
    needed = sum(widths) * (sum(sizes) if is_kept else max(sizes, default=0))
    memory, at = _workspace.take(needed, out, job.dtype), 0
    for block, size in zip(blocks, sizes, strict=True):
        h = _input(job, parts, block).t()
        hidden, at = _layers(memory, at if is_kept else 0, widths, size)
        for weight, bias, to in zip(w, b, hidden, strict=False):
            h = torch.addmm(bias, weight, h, out=to).relu_()
        _put(out, block, torch.addmm(b[-1], w[-1], h).t())
    if is_kept:
        return memory
    _workspace.give_back(memory)
    return None


def _count(block: Tensor | slice) -> int:
    return len(block) if isinstance(block, Tensor) else block.stop - block.start


def _rows(values: Tensor, block: Tensor | slice) -> Tensor:
    return values.index_select(0, block) if isinstance(block, Tensor) else values[block]


def _put(to: Tensor, block: Tensor | slice, values: Tensor) -> None:
    """Write rows; several times faster than `to[block] = values`."""
    if isinstance(block, Tensor):
        to.index_copy_(0, block, values.to(to.dtype))
    else:
        to[block] = values


def _layers(memory: Tensor, at: int, widths: list[int], size: int) -> tuple[list[Tensor], int]:
    """The hidden layers [width, size] of the block that starts at `at`, and where the next does."""
    layers = []
    for width in widths:
        layers.append(memory[at : at + width * size].view(width, size))
        at += width * size
    return layers, at


def _input(job: _Job, parts: list[Tensor], block: Tensor | slice) -> Tensor:
    return torch.cat([_rows(part, block) for part in parts], dim=1).to(job.dtype)


def _pull(
    job: _Job, tensors: Sequence[Tensor], needed: Sequence[bool], hidden: Tensor, grad: Tensor
) -> list[Tensor | None]:
    """Gradients of parts, weights and biases; None where none is needed."""
    parts, weights, biases = job.split(tensors)
    needs_parts, needs_weights, needs_biases = job.split(needed)
    w = [x.to(job.dtype) for x in weights]
    by_part = [
        _new(part, part.shape[1], job.rows is None) if is_needed else None
        for part, is_needed in zip(parts, needs_parts, strict=True)
    ]
    by_weight = [torch.zeros_like(x) for x in weights]
    by_bias = [torch.zeros_like(x) for x in biases]
    widths, at = [len(x) for x in w[:-1]], 0
    last, blocks = _last_needed(needs_parts, needs_weights, needs_biases), job.blocks(parts)
    most = max((_count(block) for block in blocks), default=0)
    # Written to in turn: memory of this size that is new each time would be mapped each time.
    turns = [grad.new_empty(max([*widths, w[0].shape[1]]) * most, dtype=job.dtype) for _ in "ab"]
    for block in blocks:
        h, at = _layers(hidden, at, widths, _count(block))
        x = _input(job, parts, block)
        v = _rows(grad, block).t().to(job.dtype)
        for k in range(len(w) - 1, last - 1, -1):
            if needs_weights[k]:
                _add_product(by_weight[k], v, h[k - 1] if k > 0 else x.t())
            if needs_biases[k]:
                by_bias[k] += v.sum(1, dtype=by_bias[k].dtype)
            if k > max(last, 0):
                v = _pulled(w[k], v, turns[k % 2])
                torch.ops.aten.threshold_backward.grad_input(v, h[k - 1], 0, grad_input=v)
        if any(needs_parts):
            columns = _pulled(w[0], v, turns[0]).t().split([part.shape[1] for part in parts], dim=1)
            for to, found in zip(by_part, columns, strict=True):
                if to is not None:
                    _put(to, block, found)
    kept = zip([*by_weight, *by_bias], [*needs_weights, *needs_biases], strict=True)
    return [*by_part, *(found if is_needed else None for found, is_needed in kept)]


def _pulled(weight: Tensor, v: Tensor, memory: Tensor) -> Tensor:
    """W^T v, in `memory`, in which v is not."""
    size = weight.shape[1] * v.shape[1]
    return torch.mm(weight.t(), v, out=memory[:size].view(weight.shape[1], v.shape[1]))


def _last_needed(
    needs_parts: Sequence[bool], needs_weights: Sequence[bool], needs_biases: Sequence[bool]
) -> int:
    """The layer at which the backward pass may stop."""
    if any(needs_parts):
        return 0
    pairs = enumerate(zip(needs_weights, needs_biases, strict=True))
    return min(k for k, both in pairs if any(both))


def _add_product(to: Tensor, v: Tensor, h: Tensor) -> None:
    """to += v h^T; the product's longer side is put last, and sums are of `to`'s dtype."""
    is_wide = len(h) >= len(v)
    total, a, b = (to, v, h) if is_wide else (to.t(), h, v)
    if to.dtype == v.dtype:
        total.addmm_(a, b.t())
    else:
        total += a @ b.t()
