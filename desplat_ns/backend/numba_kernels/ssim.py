"""The compiled part of `backend/ssim.py`: L1 and mean SSIM of two images, and the gradient of both.

With G the 11-tap Gaussian window (along y, then x, wherever it lies within the image), mx = G x,
my = G y, vx = G x^2 - mx^2, vy = G y^2 - my^2, c = G xy - mx my,

    SSIM = l s,    l = (2 mx my + C1) / (mx^2 + my^2 + C1),    s = (2 c + C2) / (vx + vy + C2)

(Wang et al. 2004, Eq. 13). With P, Q, R the derivatives of sum SSIM by mx, G x^2 and G xy,

    d sum SSIM / dx = G'P + 2 x G'Q + y G'R,

where G' is G over a border of zeros. In L1 a pixel counts by 1 - kept * owned; for SSIM y is
blended with x where it is owned, as a constant.

A worker goes down a strip of COLUMNS numbers, ROWS rows at a time: it sums SSIM over their windows,
whose P, Q, R stay in the processor's caches, and blurs these, with those of the windows above, to
the gradient of the rows. Written to memory and read again they took a third of the time. Images are
read as they lie in memory, [H, W, 3]: a row is 3 W numbers, neighbours of one channel 3 apart. They
are copied into scratch rows, over which `gaussian_window` has the window.
"""

from __future__ import annotations

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.gaussian_window import (
    ALONG,
    CHANNELS,
    COLUMNS,
    IMAGE,
    LOOSE,
    MARGIN,
    NEXT,
    OF_Q,
    OF_R,
    P1,
    P2,
    P3,
    ROWS,
    SIDE,
    SLOPES,
    STRIDE,
    blur,
    blur_slopes,
    moments,
)
from desplat_ns.backend.numba_kernels.runtime import kernel, part, take

BAND = 4
"""Blocks that a worker goes down at a time. Above the first it scores MARGIN rows that another one
scores as well."""

_C1, _C2 = np.float32(0.01**2), np.float32(0.03**2)
"""Stabilizers for images in [0, 1] (Wang et al.)."""

_ZERO, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)


@part()
def _copy_in(source, length, row, column, rows, columns, s):
    """Copy a part of an image whose rows are `length` long into scratch rows."""
    for r in range(rows):
        first, to = np.uint64((row + r) * length + column), np.uint64(r * STRIDE)
        for j in range(np.uint64(columns)):
            s[to + j] = source[first + j]


@part()
def _spread(owned, length, row, column, columns, o):
    """A part of a row of `owned`, which has a number for each pixel, for each number of an image;
    0 where `owned` is empty."""
    if owned.size == 0:
        for j in range(columns):
            o[j] = 0
        return
    first = np.uint64((row * length + column) // CHANNELS)
    for p in range(np.uint64(columns // CHANNELS)):
        for k in range(CHANNELS):
            o[CHANNELS * p + np.uint64(k)] = owned[first + p]


@part()
def _blend_in(y, owned, length, row, column, rows, columns, s, o):
    """As `_copy_in`, of y behind x, which is in the scratch rows; x where it is owned."""
    if owned.size == 0:
        _copy_in(y, length, row, column, rows, columns, s[IMAGE:])
        return
    for r in range(rows):
        _spread(owned, length, row + r, column, columns, o)
        first, to = np.uint64((row + r) * length + column), np.uint64(r * STRIDE)
        for j in range(np.uint64(columns)):
            s[NEXT + to + j] = o[j] * s[to + j] + (_ONE - o[j]) * y[first + j]


@part()
def _is_asked_for(wanted, down, across, row, column):
    """Whether any of so many blocks from (row, column) on is wanted; with none named, all are."""
    if wanted.size == 0:
        return True
    for i in range(row, min(row + down, wanted.shape[0])):
        for j in range(column, min(column + across, wanted.shape[1])):
            if wanted[i, j] > 0:
                return True
    return False


@part(fastmath=LOOSE)
def _scores(v, s, at, first, end):
    """Sum of SSIM over windows of a row; their P, Q, R go into the three rows of s."""
    total = np.float32(0)
    for j in range(np.uint64(first), np.uint64(end)):
        mx, my = blur(v, j, ALONG), blur(v, P1 + j, ALONG)
        squares, xy = blur(v, P2 + j, ALONG), blur(v, P3 + j, ALONG)
        means = mx * mx + my * my
        per_means, per_variances = _ONE / (means + _C1), _ONE / (squares - means + _C2)
        luminance = (_TWO * mx * my + _C1) * per_means
        structure = (_TWO * (xy - mx * my) + _C2) * per_variances
        score = luminance * structure
        total += score
        q, r = -score * per_variances, _TWO * luminance * per_variances
        s[at + j] = _TWO * structure * (my - mx * luminance) * per_means - _TWO * mx * q - my * r
        s[at + OF_Q + j] = q
        s[at + OF_R + j] = r
    return total


@part()
def _clear(values, first, end):
    for i in range(np.uint64(first), np.uint64(end)):
        values[i] = _ZERO


@part()
def _score(images, length, windows, block, first, scratch):
    """Sum of SSIM over a block's windows; P, Q, R of these, and of those from row `first` on.

    In the scratch rows of P, Q, R the block's first row has number MARGIN, its first number SIDE.
    """
    (x, y, owned), (row, rows, column, columns), (s, v, slopes, o) = images, block, scratch
    left, end = min(column, SIDE), min(row + rows, windows)
    count, total = min(column + columns, length - SIDE) - column + left, 0.0
    if end > first and count > 0:
        part = length, first, column - left, end - first + MARGIN, count + SIDE
        _copy_in(x, *part, s)
        _blend_in(y, owned, *part, s, o)
    for r in range(first, row + rows):
        number = count if r < end and count > 0 else 0
        if number > 0:
            moments(s, v, r - first, number + SIDE)
            to = np.uint64((r - row + MARGIN) * STRIDE + SIDE - left)
            _scores(v, slopes, to, 0, min(left, count))
            own = _scores(v, slopes, to, left, count)
            total += own if r >= row else _ZERO
        for k in range(3):
            at = k * SLOPES + (r - row + MARGIN) * STRIDE + SIDE - left
            _clear(slopes, at - SIDE + left, at)
            _clear(slopes, at + number, at + left + columns)
    return total


@part()
def _go_on(slopes):
    """P, Q, R of the last windows of a block become those above the next one."""
    for k in range(0, 3 * SLOPES, SLOPES):
        for i in range(np.uint64(k), np.uint64(k + MARGIN * STRIDE)):
            slopes[i] = slopes[i + np.uint64(ROWS * STRIDE)]


@part(fastmath=LOOSE)
def _mix(v, x, y, o, kept, gradient, at, columns, scale, scale_l1):
    """One row of the gradient of a block, from P, Q, R blurred down the window; gives its L1."""
    first, total = np.uint64(at), np.float32(0)
    for j in range(np.uint64(columns)):
        p, q = blur(v, j, ALONG), blur(v, P1 + j, ALONG)
        r = blur(v, P2 + j, ALONG)
        here, there, counted = x[first + j], y[first + j], _ONE - kept * o[j]
        off = here - there
        total += counted * abs(off)
        sign = np.float32(off > 0) - np.float32(off < 0)
        blended = o[j] * here + (_ONE - o[j]) * there
        slope = p + _TWO * here * q + blended * r
        gradient[first + j] = scale * slope + scale_l1 * (counted * sign)
    return total


@part()
def _differentiate(images, length, block, rates, scratch, gradient):
    """The gradient of a block, and its L1."""
    (x, y, owned), (row, rows, column, columns), (_, v, slopes, o) = images, block, scratch
    kept, scale, scale_l1 = rates
    total = 0.0
    for r in range(rows):
        blur_slopes(slopes, v, r, columns + SIDE)
        _spread(owned, length, row + r, column, columns, o)
        at = (row + r) * length + column
        total += _mix(v, x, y, o, kept, gradient, at, columns, scale, scale_l1)
    return total


@part()
def _go_down(images, shape, wanted, rates, blocks, strip, scratch, sums, gradient):
    """Work on the blocks of a strip from one to before another."""
    (height, length), (similarity, difference) = shape, sums
    column, slopes, above = strip * COLUMNS, scratch[2], False
    for i in range(*blocks):
        row = i * ROWS
        block = row, min(ROWS, height - row), column, min(COLUMNS, length - column)
        is_scored = _is_asked_for(wanted, 2, 2, i, strip)
        if is_scored:
            if above:
                _go_on(slopes)
            elif row == 0:
                _clear(slopes, 0, slopes.size)
            first = row if above or row == 0 else row - MARGIN
            similarity[i, strip] = _score(images, length, height - MARGIN, block, first, scratch)
        if is_scored and _is_asked_for(wanted, 1, 1, i, strip):
            difference[i, strip] = _differentiate(images, length, block, rates, scratch, gradient)
        else:
            for r in range(row, row + block[1]):
                _clear(gradient, r * length + column, r * length + column + block[3])
        above = is_scored


@kernel(parallel=True)
def score_image(images, shape, wanted, rates, sums, gradient, counter, workers):
    """Sums of SSIM and of L1 of x and y over blocks, and the gradient by x.

    Args:
        images: x and y; and what is owned, or nothing.
        shape: rows of an image, and numbers in one.
        wanted: whether a block is, [down, across]; with none named all are. Of others, those whose
            windows reach one that is have their SSIM summed, and all have no gradient.
        rates: what L1 loses where a pixel is owned; the result's gradient by the sum of SSIM, and
            by that of L1.
        sums: of SSIM over a block's windows and of L1 over its pixels, [down, across].
        gradient: like x.
    """
    down, strips = sums[0].shape
    bands = (down + BAND - 1) // BAND
    for _ in numba.prange(workers):
        s, slopes = np.empty(2 * IMAGE, np.float32), np.empty(3 * SLOPES, np.float32)
        scratch = s, np.empty(4 * STRIDE, np.float32), slopes, np.empty(STRIDE, np.float32)
        piece = take(counter)
        while piece < bands * strips:
            first = piece // strips * BAND
            blocks = first, min(first + BAND, down)
            _go_down(images, shape, wanted, rates, blocks, piece % strips, scratch, sums, gradient)
            piece = take(counter)
