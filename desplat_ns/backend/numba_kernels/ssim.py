"""The compiled part of `backend/ssim.py`: L1 and mean SSIM of two images, and the gradient of both,
in two passes.

With G the 11-tap Gaussian window (along y, then x, wherever it lies within the image), mx = G x,
my = G y, vx = G x^2 - mx^2, vy = G y^2 - my^2, c = G xy - mx my,

    SSIM = l s,    l = (2 mx my + C1) / (mx^2 + my^2 + C1),    s = (2 c + C2) / (vx + vy + C2)

(Wang et al. 2004, Eq. 13). With P, Q, R the derivatives of sum SSIM by mx, G x^2 and G xy,

    d sum SSIM / dx = G'P + 2 x G'Q + y G'R,

where G' is G over a border of zeros. The first pass sums SSIM and keeps P, Q, R with that border;
the second blurs them, and adds L1. In L1 a pixel counts by 1 - kept * owned; for SSIM y is blended
with x where it is owned, as a constant. Both work on blocks of ROWS x COLUMNS numbers, copied with
their margins into scratch rows of one fixed length: only then can the compiler see that
nothing overlaps, and use vectors. Images are read as they lie in memory, [H, W, 3]: a row is 3 W
numbers, neighbours of one
channel 3 apart.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from desplat_ns.backend.numba_kernels.runtime import kernel, take

WINDOW = 11
"""Pixels across the window; its standard deviation is 1.5 (Wang et al., and pytorch_msssim)."""

CHANNELS = 3

MARGIN = WINDOW - 1
"""Rows that the window needs beyond those it yields."""

SIDE = MARGIN * CHANNELS
"""The same along a row."""

ROWS, COLUMNS = 16, 480
"""Size of the block that comes out."""

STRIDE = 528
"""Length of a scratch row: COLUMNS + SIDE, and not near a power of two (see `pixels.PLANE`)."""

_IMAGE = (ROWS + MARGIN) * STRIDE
"""Length of the scratch rows of one image."""

_TAPS = [math.exp(-((k - 5) ** 2) / (2 * 1.5**2)) for k in range(WINDOW)]
_W0, _W1, _W2, _W3, _W4, _W5 = (np.float32(t / math.fsum(_TAPS)) for t in _TAPS[:6])

_C1, _C2 = np.float32(0.01**2), np.float32(0.03**2)
"""Stabilizers for images in [0, 1] (Wang et al.)."""

_ONE, _TWO = np.float32(1), np.float32(2)

_LOOSE = {"reassoc", "contract", "nsz"}

_DOWN, _ALONG = np.uint64(STRIDE), np.uint64(CHANNELS)
_N3, _N4, _N5 = np.uint64(3), np.uint64(4), np.uint64(5)
_P1, _P2, _P3, _P4 = (np.uint64(k * STRIDE) for k in range(1, 5))
_NEXT, _LAST = np.uint64(_IMAGE), np.uint64(2 * _IMAGE)


@kernel(fastmath=_LOOSE)
def _blur(a, i, step):
    """The symmetric window over a[i], a[i + step], ... a[i + 10 step]."""
    s1, s2, s3, s4, s5 = step, step + step, step * _N3, step * _N4, step * _N5
    i = i + s5
    near = _W5 * a[i] + _W4 * (a[i - s1] + a[i + s1]) + _W3 * (a[i - s2] + a[i + s2])
    far = _W2 * (a[i - s3] + a[i + s3]) + _W1 * (a[i - s4] + a[i + s4])
    return near + far + _W0 * (a[i - s5] + a[i + s5])


@kernel(fastmath=_LOOSE)
def _blur_product(a, i, other, step):
    """As `_blur`, of a[...] times what lies `other` further on."""
    s1, s2, s3, s4, s5 = step, step + step, step * _N3, step * _N4, step * _N5
    i = i + s5
    k = i + other
    near = _W5 * (a[i] * a[k]) + _W4 * (a[i - s1] * a[k - s1] + a[i + s1] * a[k + s1])
    near += _W3 * (a[i - s2] * a[k - s2] + a[i + s2] * a[k + s2])
    far = _W2 * (a[i - s3] * a[k - s3] + a[i + s3] * a[k + s3])
    far += _W1 * (a[i - s4] * a[k - s4] + a[i + s4] * a[k + s4])
    return near + far + _W0 * (a[i - s5] * a[k - s5] + a[i + s5] * a[k + s5])


@kernel()
def _copy_in(source, length, row, column, rows, columns, s, at):
    """Copy a block of an image whose rows are `length` long into the scratch rows from `at` on."""
    for r in range(rows):
        first, to = np.uint64((row + r) * length + column), np.uint64(at + r * STRIDE)
        for j in range(np.uint64(columns)):
            s[to + j] = source[first + j]


@kernel()
def _spread(owned, length, row, column, columns, o):
    """A part of a row of `owned`, which has a number for each pixel, for each number of an image;
    0 where `owned` is empty."""
    if owned.size == 0:
        o[:columns] = 0
        return
    first = np.uint64((row * length + column) // CHANNELS)
    for p in range(np.uint64(columns // CHANNELS)):
        for k in range(CHANNELS):
            o[CHANNELS * p + np.uint64(k)] = owned[first + p]


@kernel()
def _blend_in(y, owned, length, row, column, rows, columns, s, o):
    """As `_copy_in`, of y behind x, whose block is in the scratch rows; x where it is owned."""
    if owned.size == 0:
        _copy_in(y, length, row, column, rows, columns, s, _IMAGE)
        return
    for r in range(rows):
        _spread(owned, length, row + r, column, columns, o)
        first, to = np.uint64((row + r) * length + column), np.uint64(r * STRIDE)
        for j in range(np.uint64(columns)):
            s[_NEXT + to + j] = o[j] * s[to + j] + (_ONE - o[j]) * y[first + j]


@kernel()
def _is_asked_for(wanted, down, across, row, column):
    """Whether any of so many blocks from (row, column) on is wanted; with none named, all are."""
    if wanted.size == 0:
        return True
    for i in range(row, min(row + down, wanted.shape[0])):
        for j in range(column, min(column + across, wanted.shape[1])):
            if wanted[i, j] > 0:
                return True
    return False


@kernel(fastmath=_LOOSE)
def _moments(s, v, row, columns):
    """Means of x, y, x^2, y^2, x y down the window from a scratch row on, into the rows of v."""
    first, zero = np.uint64(row * STRIDE), np.uint64(0)
    for j in range(np.uint64(columns)):
        i = first + j
        v[j] = _blur(s, i, _DOWN)
        v[_P1 + j] = _blur(s, i + _NEXT, _DOWN)
        v[_P2 + j] = _blur_product(s, i, zero, _DOWN)
        v[_P3 + j] = _blur_product(s, i + _NEXT, zero, _DOWN)
        v[_P4 + j] = _blur_product(s, i, _NEXT, _DOWN)


@kernel(fastmath=_LOOSE)
def _scores(v, s, columns):
    """Sum of SSIM over one row of a block; its P, Q, R replace three rows of the scratch `s`."""
    total = np.float32(0)
    for j in range(np.uint64(columns)):
        mx, my = _blur(v, j, _ALONG), _blur(v, _P1 + j, _ALONG)
        xx, yy = _blur(v, _P2 + j, _ALONG), _blur(v, _P3 + j, _ALONG)
        xy = _blur(v, _P4 + j, _ALONG)
        per_means = _ONE / (mx * mx + my * my + _C1)
        per_variances = _ONE / (xx - mx * mx + (yy - my * my) + _C2)
        luminance = (_TWO * mx * my + _C1) * per_means
        structure = (_TWO * (xy - mx * my) + _C2) * per_variances
        score = luminance * structure
        total += score
        q, r = -score * per_variances, _TWO * luminance * per_variances
        s[j] = _TWO * structure * (my - mx * luminance) * per_means - _TWO * mx * q - my * r
        s[_P1 + j] = q
        s[_P2 + j] = r
    return total


@kernel()
def _clear_border(slopes, plane, height, length):
    """Zero the margins of the three planes of P, Q, R, each (height + MARGIN) x (length + SIDE)."""
    width = length + SIDE
    for k in range(3):
        for row in range(height + MARGIN):
            at = k * plane + row * width
            if MARGIN <= row < height:
                slopes[at : at + SIDE] = 0
                slopes[at + length : at + width] = 0
            else:
                slopes[at : at + width] = 0


@kernel(parallel=True)
def score_image(x, y, owned, wanted, height, length, slopes, sums, counter, workers):
    """First pass. Sum of SSIM per block into `sums`; P, Q, R into `slopes` unless that is empty.

    With `wanted` (one number for each block of pixels) only blocks whose windows reach a wanted one
    are written.
    """
    across, out_rows, out_columns = sums.shape[1], height - MARGIN, length - SIDE
    width, plane = length + SIDE, (length + SIDE) * (height + MARGIN)
    for _ in numba.prange(workers):
        s, v = np.empty(2 * _IMAGE, np.float32), np.empty(5 * STRIDE, np.float32)
        slope, o = np.empty(3 * STRIDE, np.float32), np.empty(STRIDE, np.float32)
        block = take(counter)
        while block < sums.size:
            i, j = block // across, block % across
            block = take(counter)
            if not _is_asked_for(wanted, 2, 2, i, j):
                continue
            row, column = i * ROWS, j * COLUMNS
            rows, columns = min(ROWS, out_rows - row), min(COLUMNS, out_columns - column)
            _copy_in(x, length, row, column, rows + MARGIN, columns + SIDE, s, 0)
            _blend_in(y, owned, length, row, column, rows + MARGIN, columns + SIDE, s, o)
            total = 0.0
            for r in range(rows):
                _moments(s, v, r, columns + SIDE)
                total += _scores(v, slope, columns)
                if slopes.size > 0:
                    at = (row + r + MARGIN) * width + column + SIDE
                    for k in range(3):
                        for c in range(columns):
                            slopes[k * plane + at + c] = slope[k * STRIDE + c]
            sums[i, j] = total


@kernel(fastmath=_LOOSE)
def _mix(v, x, y, o, kept, gradient, at, columns, scale, scale_l1):
    """One row of the gradient of a block, from P, Q, R blurred down the window; gives its L1."""
    first, total = np.uint64(at), np.float32(0)
    for j in range(np.uint64(columns)):
        p, q = _blur(v, j, _ALONG), _blur(v, _P1 + j, _ALONG)
        r = _blur(v, _P2 + j, _ALONG)
        here, there, counted = x[first + j], y[first + j], _ONE - kept * o[j]
        off = here - there
        total += counted * abs(off)
        sign = np.float32(off > 0) - np.float32(off < 0)
        blended = o[j] * here + (_ONE - o[j]) * there
        slope = p + _TWO * here * q + blended * r
        gradient[first + j] = scale * slope + scale_l1 * (counted * sign)
    return total


@kernel(fastmath=_LOOSE)
def _blur_slopes(s, v, row, columns):
    """P, Q, R down the window from a scratch row on, into the rows of v."""
    first = np.uint64(row * STRIDE)
    for j in range(np.uint64(columns)):
        v[j] = _blur(s, first + j, _DOWN)
        v[_P1 + j] = _blur(s, first + _NEXT + j, _DOWN)
        v[_P2 + j] = _blur(s, first + _LAST + j, _DOWN)


@kernel(parallel=True)
def backward_image(
    x,
    y,
    owned,
    wanted,
    height,
    length,
    slopes,
    kept,
    scale,
    scale_l1,
    sums_l1,
    out,
    counter,
    workers,
):
    """Second pass. L1 per block of pixels into `sums_l1`; into `out` the gradient, by x, of `scale`
    times the sum of SSIM and `scale_l1` times L1 (0 in blocks that are not wanted)."""
    down, across = sums_l1.shape
    width, plane = length + SIDE, (length + SIDE) * (height + MARGIN)
    _clear_border(slopes, plane, height, length)
    for _ in numba.prange(workers):
        s, v = np.empty(3 * _IMAGE, np.float32), np.empty(3 * STRIDE, np.float32)
        o = np.empty(STRIDE, np.float32)
        block = take(counter)
        while block < across * down:
            i, j = block // across, block % across
            block = take(counter)
            row, column = i * ROWS, j * COLUMNS
            rows, columns = min(ROWS, height - row), min(COLUMNS, length - column)
            if not _is_asked_for(wanted, 1, 1, i, j):
                for r in range(row, row + rows):
                    out[r * length + column : r * length + column + columns] = 0
                continue
            for k in range(3):
                part = slopes[k * plane : (k + 1) * plane]
                _copy_in(part, width, row, column, rows + MARGIN, columns + SIDE, s, k * _IMAGE)
            total = 0.0
            for r in range(rows):
                _blur_slopes(s, v, r, columns + SIDE)
                _spread(owned, length, row + r, column, columns, o)
                at = (row + r) * length + column
                total += _mix(v, x, y, o, kept, out, at, columns, scale, scale_l1)
            sums_l1[i, j] = total
