"""View-dependent colours max(SH + 1/2, 0), compiled, with their gradients.

On the unit sphere each harmonic is a polynomial of the direction (x, y, z): a list of terms c x^i
y^j z^k, read off `spherical_harmonics.py`'s definition once. With colour = sum_k B_k(d) f_k and v =
dL/dcolour (as `projection.cut_at_zero` has it), d = r / |r|, r = mean - camera,

    dL/df_k = B_k v,    dL/dd = sum_k (f_k . v) grad B_k,    dL/dr = (dL/dd - d (d . dL/dd)) / |r|.

Directions are worked on in batches that lie in planes, as in `projection`; the coefficients,
which are most of the memory, are read and written once, in their order.
"""

import math
from functools import cache

import numba
import numpy as np
import torch

from desplat_ns.backend.numba_kernels.projection import BATCH, LANE
from desplat_ns.backend.numba_kernels.runtime import batches, empty, flat, kernel, launch, part
from desplat_ns.backend.spherical_harmonics import MAX_DEGREE, legendre, norm

_POWERS = MAX_DEGREE + 1
"""Planes of x^0 ... x^4, then as many of y and of z."""

_BASIS = 3 * _POWERS
"""First plane of the harmonics; in the backward pass of f_k . v."""

_PLANES = _BASIS + (MAX_DEGREE + 1) ** 2
_LENGTH, _GRAD = np.uint64(LANE * _PLANES), tuple(LANE * (_PLANES + 1 + k) for k in range(3))
"""1 / |r|, and dL/dd."""

_LOOSE = {"reassoc", "contract", "nsz"}
_LANES, _ZERO, _ONE = np.uint64(BATCH), np.float32(0), np.float32(1)


@cache
def sh_terms(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Terms of all harmonics up to `degree`: harmonic and powers [terms, 4], coefficients [terms].

    A harmonic of order m is a polynomial of z times the real part of (x + i y)^m, or the imaginary
    part of (x + i y)^-m.
    """
    places, coefficients = [], []
    for n in range(degree + 1):
        for m in range(-n, n + 1):
            a = abs(m)
            for j in range(int(m < 0), a + 1, 2):
                azimuth = math.comb(a, j) * (-1.0) ** (j // 2)
                for power, c in legendre(n, a).items():
                    places.append((n * n + n + m, a - j, j, power))
                    coefficients.append(azimuth * (norm(n, a) * c))
    return np.array(places, np.int64).reshape(-1, 4), np.array(coefficients, np.float32)


@part(fastmath=_LOOSE)
def _directions(means, center, first, number, s):
    """Powers of the unit directions from the camera, and 1 / |r|."""
    for k in range(BATCH):
        i = 3 * (first + min(k, number - 1))
        s[LANE + k] = means[i] - center[0]
        s[LANE * (_POWERS + 1) + k] = means[i + 1] - center[1]
        s[LANE * (2 * _POWERS + 1) + k] = means[i + 2] - center[2]
    x, y = np.uint64(LANE), np.uint64(LANE * (_POWERS + 1))
    z = np.uint64(LANE * (2 * _POWERS + 1))
    for n in range(_LANES):
        square = s[x + n] * s[x + n] + s[y + n] * s[y + n] + s[z + n] * s[z + n]
        per = _ONE / np.sqrt(square)
        s[_LENGTH + n] = per
        s[x + n], s[y + n], s[z + n] = s[x + n] * per, s[y + n] * per, s[z + n] * per
    for axis in range(3):
        base = np.uint64(LANE * _POWERS * axis)
        for n in range(_LANES):
            s[base + n] = _ONE
        for power in range(2, _POWERS):
            plane = base + np.uint64(LANE * power)
            for n in range(_LANES):
                s[plane + n] = s[plane - np.uint64(LANE) + n] * s[base + np.uint64(LANE) + n]


@part()
def _plane(axis, power):
    return np.uint64(LANE * (_POWERS * axis + power))


@part(fastmath=_LOOSE)
def _harmonics(places, coefficients, bases, s):
    """Fill the planes of the harmonics."""
    for k in range(LANE * _BASIS, LANE * (_BASIS + bases)):
        s[k] = 0
    for term in range(coefficients.size):
        to = np.uint64(LANE * (_BASIS + places[term, 0]))
        x, y, z = _plane(0, places[term, 1]), _plane(1, places[term, 2]), _plane(2, places[term, 3])
        for n in range(_LANES):
            s[to + n] += coefficients[term] * (s[x + n] * s[y + n] * s[z + n])


@part(fastmath=_LOOSE)
def _slopes(places, coefficients, s):
    """dL/dd from the planes of f_k . v."""
    for axis in range(3):
        to = np.uint64(_GRAD[axis])
        for n in range(_LANES):
            s[to + n] = 0
        for term in range(coefficients.size):
            powers = places[term, 1:]
            if powers[axis] == 0:
                continue
            x, y = _plane(0, powers[0] - (axis == 0)), _plane(1, powers[1] - (axis == 1))
            z, q = _plane(2, powers[2] - (axis == 2)), np.uint64(LANE * (_BASIS + places[term, 0]))
            c = coefficients[term] * np.float32(powers[axis])
            for n in range(_LANES):
                s[to + n] += c * s[q + n] * (s[x + n] * s[y + n] * s[z + n])


@kernel(fastmath=_LOOSE, parallel=True)
def _evaluate(means, values, radii, center, places, coefficients, sizes, out, counter, workers):
    """Colours [N, 3] from coefficients [N, stored, 3]; sizes = (stored, used, whether colours are
    cut off at 0). 0 where culled."""
    stored, used, is_cut = sizes
    least = _ZERO if is_cut else -np.float32(np.inf)
    for _ in numba.prange(workers):
        s = np.empty(LANE * (_PLANES + 4), np.float32)
        for first, end in batches(counter, radii.size, BATCH):
            number = end - first
            _directions(means, center, first, number, s)
            _harmonics(places, coefficients, used, s)
            for k in range(number):
                r = g = b = _ZERO
                if radii[first + k] > 0:
                    at, plane = (first + k) * stored * 3, LANE * _BASIS + k
                    for basis in range(used):
                        weight = s[plane + LANE * basis]
                        r += weight * values[at + 3 * basis]
                        g += weight * values[at + 3 * basis + 1]
                        b += weight * values[at + 3 * basis + 2]
                    half = np.float32(0.5)
                    r, g, b = max(r + half, least), max(g + half, least), max(b + half, least)
                i = 3 * (first + k)
                out[i], out[i + 1], out[i + 2] = r, g, b


@part(fastmath=_LOOSE)
def _backward_values(values, out, grad, i, sizes, s, plane, v_values):
    """Gradients of the coefficients of the i-th Gaussian; f_k . v takes the place of B_k."""
    stored, used, is_cut = sizes
    r, g, b = grad[3 * i], grad[3 * i + 1], grad[3 * i + 2]
    if is_cut:
        r = r if out[3 * i] > _ZERO or r < _ZERO else _ZERO
        g = g if out[3 * i + 1] > _ZERO or g < _ZERO else _ZERO
        b = b if out[3 * i + 2] > _ZERO or b < _ZERO else _ZERO
    for basis in range(used):
        at, lane = 3 * (i * stored + basis), plane + LANE * basis
        weight = s[lane]
        s[lane] = values[at] * r + values[at + 1] * g + values[at + 2] * b
        v_values[at], v_values[at + 1], v_values[at + 2] = weight * r, weight * g, weight * b
    for k in range(3 * (i * stored + used), 3 * (i + 1) * stored):
        v_values[k] = 0


@kernel(fastmath=_LOOSE, parallel=True)
def _backward(
    means, values, radii, center, places, coefficients, sizes, out, grad, v_means, v_values,
    counter, workers,
):  # fmt: skip
    """The reverse of `_evaluate`, from dL/dcolour, `grad`."""
    stored, used, _ = sizes
    for _ in numba.prange(workers):
        s = np.empty(LANE * (_PLANES + 4), np.float32)
        for first, end in batches(counter, radii.size, BATCH):
            number = end - first
            _directions(means, center, first, number, s)
            _harmonics(places, coefficients, used, s)
            for k in range(number):
                if radii[first + k] > 0:
                    plane = LANE * _BASIS + k
                    _backward_values(values, out, grad, first + k, sizes, s, plane, v_values)
                else:
                    for at in range(3 * (first + k) * stored, 3 * (first + k + 1) * stored):
                        v_values[at] = 0
            _slopes(places, coefficients, s)
            for k in range(number):
                _backward_direction(s, k, radii[first + k] > 0, 3 * (first + k), v_means)


@part()
def _backward_direction(s, k, is_seen, at, v_means):
    """Gradient by the mean, from dL/dd of the k-th direction."""
    gx, gy, gz = s[_GRAD[0] + k], s[_GRAD[1] + k], s[_GRAD[2] + k]
    x, y = s[LANE + k], s[LANE * (_POWERS + 1) + k]
    z = s[LANE * (2 * _POWERS + 1) + k]
    along, per = gx * x + gy * y + gz * z, s[np.int64(_LENGTH) + k]
    v_means[at] = per * (gx - along * x) if is_seen else _ZERO
    v_means[at + 1] = per * (gy - along * y) if is_seen else _ZERO
    v_means[at + 2] = per * (gz - along * z) if is_seen else _ZERO


class EvaluateColors(torch.autograd.Function):
    """(means, coefficients [N, K, 3], radii, camera centre, degree, whether they are cut off at 0)
    -> colours [N, 3]; if they are not cut off, also the zeroth coefficients [N, 3].

    Taken from the coefficients by themselves, those would get a gradient of all K."""

    @staticmethod
    def forward(ctx, means, values, radii, center, degree, is_cut=True):  # type: ignore[override]
        out, terms = empty(means.shape[0], 3), sh_terms(degree)
        ctx.save_for_backward(means, values, radii, center, out)
        inputs = map(flat, (means, values, radii, center))
        sizes = (values.shape[1], (degree + 1) ** 2, int(is_cut))
        launch(_evaluate, *inputs, *terms, sizes, flat(out))
        ctx.state = (terms, sizes, values.shape)
        return out if is_cut else (out, values[:, 0].clone())

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad, by_zeroth=None):  # type: ignore[override]
        *inputs, out = map(flat, ctx.saved_tensors)
        terms, sizes, shape = ctx.state
        v_means, v_values = empty(shape[0], 3), empty(*shape)
        made = (out, *map(flat, (grad, v_means, v_values)))
        launch(_backward, *inputs, *terms, sizes, *made)
        if by_zeroth is not None:
            v_values[:, 0] += by_zeroth
        return v_means, v_values, None, None, None, None
