"""The compiled part of `backend/over.py`: a layer over what lies behind it, and gradients.

With c = top + (1 - alpha) below for each colour, and v = dL/dc,

    dL/dtop = v,    dL/dalpha = -sum_colours v below,    dL/dbelow = (1 - alpha) v.

Nothing is contracted to multiply-adds, so that colours have the bits of torch's formula.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, take

CHANNELS = 3

PIXELS = 4096
"""That one worker takes at a time."""

_ZERO, _ONE = np.float32(0), np.float32(1)


@kernel(parallel=True)
def put_over(top, alpha, below, out, counter, workers):
    """Colours of all pixels; `below` has one colour, or one for each pixel."""
    step = 0 if below.size == CHANNELS else CHANNELS
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < alpha.size:
            for p in range(first, min(first + PIXELS, alpha.size)):
                i, k, clear = CHANNELS * p, step * p, _ONE - alpha[p]
                out[i] = top[i] + clear * below[k]
                out[i + 1] = top[i + 1] + clear * below[k + 1]
                out[i + 2] = top[i + 2] + clear * below[k + 2]
            first = take(counter) * PIXELS


@kernel(parallel=True)
def pull_under(grad, alpha, below, by_alpha, by_below, counter, workers):
    """Gradients from v, `grad`; `by_below` is empty where nobody asks for it."""
    step = 0 if below.size == CHANNELS else CHANNELS
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < alpha.size:
            for p in range(first, min(first + PIXELS, alpha.size)):
                i, k = CHANNELS * p, step * p
                r, g, b = grad[i], grad[i + 1], grad[i + 2]
                by_alpha[p] = -(r * below[k] + g * below[k + 1] + b * below[k + 2])
                if by_below.size > 0:
                    clear = _ONE - alpha[p]
                    by_below[i], by_below[i + 1], by_below[i + 2] = r * clear, g * clear, b * clear
            first = take(counter) * PIXELS


@kernel(parallel=True)
def pull_within(grad, image, out, counter, workers):
    """The gradient of a clamp to [0, 1]: that of colours strictly within."""
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < image.size:
            for i in range(first, min(first + PIXELS, image.size)):
                out[i] = grad[i] if image[i] > _ZERO and image[i] < _ONE else _ZERO
            first = take(counter) * PIXELS
