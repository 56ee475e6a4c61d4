"""The numba tile kernels: blend a tile front to back, and pull gradients through it back to front.

With alpha_i the opacity of the i-th Gaussian at a pixel, T_i the transmittance in front of it, f_i
its features (colours, depth) and w_i = alpha_i T_i, the forward pass sums

    F = sum_i w_i f_i,    A = sum_i w_i = 1 - T_end,    T_{i+1} = T_i (1 - alpha_i).

Given dL/dF = v and dL/dA = u at the pixel, let q_i = v . f_i + u. Then

    dL/dalpha_i = T_i q_i - S_i / (1 - alpha_i),    S_i = sum_{j > i} w_j q_j,
    dL/df_i     = w_i v,

so that one running scalar S per pixel replaces one per channel. T_i = T_{i+1} / (1 - alpha_i) is
undone from the end, starting at the last Gaussian that the forward pass drew at this pixel. With d
= mean - pixel, g = conic d and sigma = d . g / 2, and h = dL/dsigma = -alpha dL/dalpha (0 where
alpha is clamped),

    dL/dmean = h g,   dL/dconic = h (d_x^2 / 2, d_x d_y, d_y^2 / 2),   dL/dopacity = -h / opacity.

A tile is 256 pixels stored block by block of BLOCK columns, row by row within. Each Gaussian visits
the rows that it can reach, which lie next to each other in that order: one flat loop, which the
compiler turns into vector instructions. For that, everything that the loop touches lies in one
array of planes of float32 (no aliasing to rule out), indices are unsigned, exp is a polynomial, and
the loop is seen to take whole PAIRs of rows, so that it has no rest.
"""

from typing import NamedTuple

import numpy as np

from desplat_ns.backend.numba_kernels.ellipses import (
    BLOCK,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FEATURES,
    MEAN_X,
    MEAN_Y,
    OPACITY,
    PAIR,
    TILE,
)
from desplat_ns.backend.numba_kernels.runtime import fma, part

AREA = TILE * TILE
"""Pixels of a tile."""

PLANE = AREA + 16
"""Distance between planes. Not AREA: planes 4096 bytes apart would look like one address to the
processor's store buffer, and loads would wait for stores to another plane."""

COLUMN = TILE * BLOCK
"""Pixels of one block of columns."""

PLANES = 10

X, Y, T, LAST, SUM, U, F0, F1, F2, F3 = (np.uint64(PLANE * k) for k in range(PLANES))
"""Where the planes start: pixel centre, transmittance, place in the list of the last Gaussian
drawn; for the backward pass S and u; then a plane per feature with F, or dL/dF."""

GEOMETRY = 8
"""Gradients of an entry before its features: mean x, y; |mean| x, y; conic a, b, c; opacity."""

WIDTH = GEOMETRY + 4
"""Gradients of an entry: of the geometry, of three colours and of the depth."""

_EXP2 = tuple(
    np.float32(c) for c in (1.0, 0.69314698, 0.24022242, 0.05550734, 0.00967151, 0.00132647)
)
"""Polynomial of 2^x for x in [-1/2, 1/2], fitted for the least relative error: 9e-8."""

_K = np.float32(-0.7213475204444817)
"""-log2(e) / 2: exp(-q / 2) = 2^(k q)."""

_PER_K = np.float32(1 / -0.7213475204444817)

_ONE, _HALF, _ZERO = np.float32(1), np.float32(0.5), np.float32(0)

NO_SUMS = (_ZERO,) * WIDTH
"""Where the sums over pixels of an entry start."""

_LOOSE = {"reassoc", "contract", "nsz"}
"""Lets the compiler reorder the sums over pixels (which the loop needs to be vectorised); never
used on what decides whether a Gaussian is drawn."""


class Limits(NamedTuple):
    """The constants of backend/constants.py, as arguments: measurements turn them."""

    alpha_max: np.float32
    alpha_cutoff: np.float32
    transmittance_min: np.float32


@part()
def _exp2(power):
    """2^power for power <= 0, within 2 units in the last place above 2^-40; as small below."""
    whole = np.rint(power)
    x = power - whole
    value = fma(_EXP2[5], x, _EXP2[4])
    value = fma(value, x, _EXP2[3])
    value = fma(value, x, _EXP2[2])
    value = fma(value, x, _EXP2[1])
    value = fma(value, x, _EXP2[0])
    # Smaller ones would bring denormal numbers, which are slow, and are far below any cutoff.
    exponent = max(np.int32(whole) + np.int32(127), np.int32(87))
    return value * np.int32(exponent << np.int32(23)).view(np.float32)


@part()
def _falloff_at(s, p, mean_x, mean_y, a, b, c):
    """(exp(-sigma), k g_x, k g_y, d_x, d_y) at pixel p, from k times the conic, k = -log2(e) / 2.
    The same instructions in both passes. Where rounding turns sigma of a needle negative, it is 0.
    """
    dx, dy = mean_x - s[X + p], mean_y - s[Y + p]
    gx, gy = fma(a, dx, b * dy), fma(b, dx, c * dy)
    return _exp2(min(fma(dx, gx, dy * gy), _ZERO)), gx, gy, dx, dy


@part()
def _shape(records, base):
    """Mean, k times the conic, and opacity of a record."""
    return (
        records[base + MEAN_X],
        records[base + MEAN_Y],
        _K * records[base + CONIC_A],
        _K * records[base + CONIC_B],
        _K * records[base + CONIC_C],
        records[base + OPACITY],
    )


@part()
def _four(values, at):
    return values[at], values[at + 1], values[at + 2], values[at + 3]


@part(fastmath={"nsz"}, forceinline=True)
def blend(s, records, base, place, start, stop, limits):
    """Draw one Gaussian over pixels start ... stop - 1, which are PAIRs."""
    mean_x, mean_y, a, b, c, opacity = _shape(records, base)
    f0, f1, f2, f3 = _four(records, base + FEATURES)
    alpha_max, cutoff, least = limits
    for k in range(np.uint64(PAIR) * np.uint64((stop - start) // PAIR)):
        p = np.uint64(start) + k
        falloff = _falloff_at(s, p, mean_x, mean_y, a, b, c)[0]
        alpha = min(opacity * falloff, alpha_max)
        t, last = s[T + p], s[LAST + p]
        behind = t * (_ONE - alpha)
        visible = (alpha >= cutoff) & (t > _ZERO)
        drawn = visible & (behind > least)
        weight = alpha * t
        weight = weight if drawn else _ZERO
        finished = -t if visible else t  # a negative sign: this pixel is finished
        s[T + p] = behind if drawn else finished
        s[LAST + p] = place if drawn else last
        s[F0 + p] = fma(weight, f0, s[F0 + p])
        s[F1 + p] = fma(weight, f1, s[F1 + p])
        s[F2 + p] = fma(weight, f2, s[F2 + p])
        s[F3 + p] = fma(weight, f3, s[F3 + p])


@part(fastmath=_LOOSE, forceinline=True)
def backward(s, records, base, place, start, stop, limits, sums):
    """Step back over one Gaussian at pixels start ... stop - 1, which are PAIRs; add to its `sums`
    and return them.

    One loop, although it takes more registers than there are without AVX-512: two or three shorter
    ones load and store more, and each ends in a branch that the processor guesses wrong.
    """
    mean_x, mean_y, a, b, c, opacity = _shape(records, base)
    f0, f1, f2, f3 = _four(records, base + FEATURES)
    alpha_max, cutoff, _ = limits
    sum_x, sum_y, abs_x, abs_y, xx, xy, yy, total, v0, v1, v2, v3 = sums
    for k in range(np.uint64(PAIR) * np.uint64((stop - start) // PAIR)):
        p = np.uint64(start) + k
        falloff, gx, gy, dx, dy = _falloff_at(s, p, mean_x, mean_y, a, b, c)
        raw = opacity * falloff
        alpha = min(raw, alpha_max)
        drawn = (alpha >= cutoff) & (s[LAST + p] >= place)
        per_clear = _ONE / (_ONE - alpha)
        end, later = s[T + p], s[SUM + p]
        q = s[U + p] + f0 * s[F0 + p] + f1 * s[F1 + p] + f2 * s[F2 + p] + f3 * s[F3 + p]
        t = end * per_clear
        weight = alpha * t
        weight = weight if drawn else _ZERO
        h = raw * (later * per_clear - t * q)
        h = h if drawn & (raw <= alpha_max) else _ZERO
        s[T + p] = t if drawn else end
        s[SUM + p] = later + weight * q
        v0, v1 = v0 + weight * s[F0 + p], v1 + weight * s[F1 + p]
        v2, v3 = v2 + weight * s[F2 + p], v3 + weight * s[F3 + p]
        hx, hy, hdx = h * gx, h * gy, h * dx
        sum_x, sum_y, total = sum_x + hx, sum_y + hy, total + h
        abs_x, abs_y = abs_x + abs(hx), abs_y + abs(hy)
        xx, xy, yy = xx + hdx * dx, xy + hdx * dy, yy + h * dy * dy
    return sum_x, sum_y, abs_x, abs_y, xx, xy, yy, total, v0, v1, v2, v3


@part()
def write_row(sums, opacity, grads, row):
    """Turn the sums of `backward` into the gradients of an entry."""
    sum_x, sum_y, abs_x, abs_y, xx, xy, yy, total, v0, v1, v2, v3 = sums
    by_mean = (_PER_K * sum_x, _PER_K * sum_y, -_PER_K * abs_x, -_PER_K * abs_y)
    entry = (*by_mean, _HALF * xx, xy, _HALF * yy, -total / opacity, v0, v1, v2, v3)
    for k in range(WIDTH):
        grads[row + k] = entry[k]
