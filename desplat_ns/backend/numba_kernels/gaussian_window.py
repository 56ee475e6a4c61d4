"""The Gaussian window of SSIM, over scratch rows: a part of `ssim`, which says what it is for.

Scratch rows have one fixed length, STRIDE: only then can the compiler see that nothing overlaps,
and use vectors. Rows of y lie IMAGE numbers behind those of x; rows of Q and of R lie SLOPES and
2 SLOPES behind those of P. Products are made anew in each window: to keep them in rows of their own
takes a tenth to a sixth more time.
"""

from __future__ import annotations

import math

import numpy as np

from desplat_ns.backend.numba_kernels.runtime import part

WINDOW = 11
"""Pixels across the window; its standard deviation is 1.5 (Wang et al., and pytorch_msssim)."""

CHANNELS = 3

MARGIN = WINDOW - 1
"""Rows that the window needs beyond those it yields."""

SIDE = MARGIN * CHANNELS
"""The same along a row."""

ROWS, COLUMNS = 16, 480
"""Size of the block that comes out."""

STRIDE = 544
"""Length of a scratch row: COLUMNS + 2 SIDE, and not near a power of two (see `pixels.PLANE`)."""

IMAGE = (ROWS + 2 * MARGIN) * STRIDE
"""Length of the scratch rows of one image."""

SLOPES = (ROWS + MARGIN) * STRIDE
"""The same of P, of Q and of R."""

_TAPS = [math.exp(-((k - 5) ** 2) / (2 * 1.5**2)) for k in range(WINDOW)]
_W0, _W1, _W2, _W3, _W4, _W5 = (np.float32(t / math.fsum(_TAPS)) for t in _TAPS[:6])

LOOSE = {"reassoc", "contract", "nsz"}
"""What the compiler may do with sums here."""

ALONG = np.uint64(CHANNELS)
"""From a number to that of the next pixel."""

_DOWN = np.uint64(STRIDE)
_N2, _N3, _N4, _N5 = (np.uint64(k) for k in range(2, 6))
P1, P2, P3 = (np.uint64(k * STRIDE) for k in range(1, 4))
"""Where the second, third and fourth of several rows begin."""

NEXT, OF_Q, OF_R = np.uint64(IMAGE), np.uint64(SLOPES), np.uint64(2 * SLOPES)


@part(fastmath=LOOSE)
def blur(a, i, step):
    """The symmetric window over a[i], a[i + step], ... a[i + 10 step]."""
    s1, s2, s3, s4, s5 = step, step + step, step * _N3, step * _N4, step * _N5
    i = i + s5
    near = _W5 * a[i] + _W4 * (a[i - s1] + a[i + s1]) + _W3 * (a[i - s2] + a[i + s2])
    far = _W2 * (a[i - s3] + a[i + s3]) + _W1 * (a[i - s4] + a[i + s4])
    return near + far + _W0 * (a[i - s5] + a[i + s5])


@part(fastmath=LOOSE)
def _squares(a, i):
    x, y = a[i], a[NEXT + i]
    return x * x + y * y


@part(fastmath=LOOSE)
def _product(a, i):
    return a[i] * a[NEXT + i]


@part(fastmath=LOOSE)
def _blur_squares(a, i):
    """As `blur`, down x^2 + y^2."""
    i, s = i + _DOWN * _N5, _DOWN
    near = _W5 * _squares(a, i) + _W4 * (_squares(a, i - s) + _squares(a, i + s))
    near += _W3 * (_squares(a, i - s * _N2) + _squares(a, i + s * _N2))
    far = _W2 * (_squares(a, i - s * _N3) + _squares(a, i + s * _N3))
    far += _W1 * (_squares(a, i - s * _N4) + _squares(a, i + s * _N4))
    return near + far + _W0 * (_squares(a, i - s * _N5) + _squares(a, i + s * _N5))


@part(fastmath=LOOSE)
def _blur_product(a, i):
    """As `blur`, down x y."""
    i, s = i + _DOWN * _N5, _DOWN
    near = _W5 * _product(a, i) + _W4 * (_product(a, i - s) + _product(a, i + s))
    near += _W3 * (_product(a, i - s * _N2) + _product(a, i + s * _N2))
    far = _W2 * (_product(a, i - s * _N3) + _product(a, i + s * _N3))
    far += _W1 * (_product(a, i - s * _N4) + _product(a, i + s * _N4))
    return near + far + _W0 * (_product(a, i - s * _N5) + _product(a, i + s * _N5))


@part(fastmath=LOOSE)
def moments(s, v, row, columns):
    """Means of x, y, x^2 + y^2, x y down the window from a scratch row on, into the rows of v."""
    first = np.uint64(row * STRIDE)
    for j in range(np.uint64(columns)):
        i = first + j
        v[j] = blur(s, i, _DOWN)
        v[P1 + j] = blur(s, i + NEXT, _DOWN)
        v[P2 + j] = _blur_squares(s, i)
        v[P3 + j] = _blur_product(s, i)


@part(fastmath=LOOSE)
def blur_slopes(slopes, v, row, columns):
    """P, Q, R down the window from a scratch row on, into the rows of v."""
    first = np.uint64(row * STRIDE)
    for j in range(np.uint64(columns)):
        v[j] = blur(slopes, first + j, _DOWN)
        v[P1 + j] = blur(slopes, OF_Q + first + j, _DOWN)
        v[P2 + j] = blur(slopes, OF_R + first + j, _DOWN)
