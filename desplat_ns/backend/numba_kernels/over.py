"""The compiled part of `backend/over.py`: a layer over what lies behind it, and gradients.

With c = top + (1 - alpha) below for each colour, and v = dL/dc,

    dL/dtop = v,    dL/dalpha = -sum_colours v below,    dL/dbelow = (1 - alpha) v.

Where colours are cut to [0, 1], v is 0 for those that are not strictly within. Nothing is
contracted to multiply-adds, so that colours have the bits of torch's formula. Pixels are numbered
by unsigned integers, or numba would look at each for a negative one: two to five times the time.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, part, take

CHANNELS = 3

PIXELS = 4096
"""That one worker takes at a time."""

_ZERO, _ONE = np.float32(0), np.float32(1)
_1, _2, _3 = np.uint64(1), np.uint64(2), np.uint64(CHANNELS)


@part()
def _is_within(value):
    return (value > _ZERO) & (value < _ONE)


@part()
def _cut(value, is_cut):
    """In [0, 1] where colours are cut; NaN stays."""
    return (_ZERO if value < _ZERO else _ONE if value > _ONE else value) if is_cut else value


@part()
def _put(top, alpha, below, step, is_cut, out, first, end):
    """Colours of the pixels from `first` to before `end`; the next one is `step` on in `below`."""
    for p in range(np.uint64(first), np.uint64(end)):
        i, k, clear = _3 * p, step * p, _ONE - alpha[p]
        out[i] = _cut(top[i] + clear * below[k], is_cut)
        out[i + _1] = _cut(top[i + _1] + clear * below[k + _1], is_cut)
        out[i + _2] = _cut(top[i + _2] + clear * below[k + _2], is_cut)


@kernel(parallel=True)
def put_over(top, alpha, below, out, is_cut, counter, workers):
    """Colours of all pixels; `below` has one colour, or one for each pixel."""
    step = np.uint64(0 if below.size == CHANNELS else CHANNELS)
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < alpha.size:
            _put(top, alpha, below, step, is_cut, out, first, min(first + PIXELS, alpha.size))
            first = take(counter) * PIXELS


@part()
def _pull_cut(grad, top, alpha, below, step, by_top, first, end):
    """v of the pixels from `first` to before `end`, where colours are cut."""
    for p in range(np.uint64(first), np.uint64(end)):
        i, k, clear = _3 * p, step * p, _ONE - alpha[p]
        by_top[i] = grad[i] if _is_within(top[i] + clear * below[k]) else _ZERO
        is_green = _is_within(top[i + _1] + clear * below[k + _1])
        by_top[i + _1] = grad[i + _1] if is_green else _ZERO
        is_blue = _is_within(top[i + _2] + clear * below[k + _2])
        by_top[i + _2] = grad[i + _2] if is_blue else _ZERO


@part()
def _pull_alpha(v, below, step, by_alpha, first, end):
    for p in range(np.uint64(first), np.uint64(end)):
        i, k = _3 * p, step * p
        by_alpha[p] = -(v[i] * below[k] + v[i + _1] * below[k + _1] + v[i + _2] * below[k + _2])


@part()
def _pull_below(v, alpha, by_below, first, end):
    for p in range(np.uint64(first), np.uint64(end)):
        i, clear = _3 * p, _ONE - alpha[p]
        by_below[i], by_below[i + _1] = v[i] * clear, v[i + _1] * clear
        by_below[i + _2] = v[i + _2] * clear


@kernel(parallel=True)
def pull_under(grad, top, alpha, below, by_top, by_alpha, by_below, counter, workers):
    """Gradients. Where colours are not cut, v is `grad` and `by_top` is empty; `by_below` is empty
    where nobody asks for it."""
    step = np.uint64(0 if below.size == CHANNELS else CHANNELS)
    v = by_top if by_top.size > 0 else grad
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < alpha.size:
            end = min(first + PIXELS, alpha.size)
            if by_top.size > 0:
                _pull_cut(grad, top, alpha, below, step, by_top, first, end)
            _pull_alpha(v, below, step, by_alpha, first, end)
            if by_below.size > 0:
                _pull_below(v, alpha, by_below, first, end)
            first = take(counter) * PIXELS


@part()
def _within(grad, image, out, first, end):
    for i in range(np.uint64(first), np.uint64(end)):
        out[i] = grad[i] if _is_within(image[i]) else _ZERO


@kernel(parallel=True)
def pull_within(grad, image, out, counter, workers):
    """The gradient of a cut to [0, 1]."""
    for _ in numba.prange(workers):
        first = take(counter) * PIXELS
        while first < image.size:
            _within(grad, image, out, first, min(first + PIXELS, image.size))
            first = take(counter) * PIXELS
