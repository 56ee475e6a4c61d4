"""The compiled part of `backend/layers.py`: one layer over another, and its gradients.

Images are read as they lie in memory, [H, W, 3]; what lies behind may be one colour.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, take

CHANNELS = 3

BLOCK = 4096
"""Pixels that a worker takes at a time."""

_ZERO, _ONE = np.float32(0), np.float32(1)


@kernel(parallel=True)
def over_image(front, alpha, behind, is_cut, out, counter, workers):
    """front + (1 - alpha) behind into `out`, cut to [0, 1] if so asked."""
    step = 0 if behind.size == CHANNELS else CHANNELS
    for _ in numba.prange(workers):
        first = take(counter) * BLOCK
        while first < alpha.size:
            for p in range(first, min(first + BLOCK, alpha.size)):
                through = _ONE - alpha[p]
                for c in range(CHANNELS):
                    color = front[CHANNELS * p + c] + through * behind[step * p + c]
                    out[CHANNELS * p + c] = min(max(color, _ZERO), _ONE) if is_cut else color
            first = take(counter) * BLOCK


@kernel(parallel=True)
def over_image_backward(
    front, alpha, behind, is_cut, grad, by_front, by_alpha, by_behind, counter, workers
):
    """Gradients from that of `out`; `by_behind` may be empty. What was cut off has none."""
    step = 0 if behind.size == CHANNELS else CHANNELS
    for _ in numba.prange(workers):
        first = take(counter) * BLOCK
        while first < alpha.size:
            for p in range(first, min(first + BLOCK, alpha.size)):
                through, total = _ONE - alpha[p], _ZERO
                for c in range(CHANNELS):
                    i, back = CHANNELS * p + c, behind[step * p + c]
                    color, slope = front[i] + through * back, grad[i]
                    if is_cut and (color < _ZERO or color > _ONE):
                        slope = _ZERO
                    by_front[i] = slope
                    total -= slope * back
                    if by_behind.size > 0:
                        by_behind[i] = through * slope
                by_alpha[p] = total
            first = take(counter) * BLOCK
