"""Real spherical harmonics in the sign convention of 3DGS and gsplat.

Coefficients are ordered (degree, order) with order from -degree to +degree: K = (degree + 1)^2.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

MAX_DEGREE = 4

C0 = 0.5 / math.sqrt(math.pi)
"""The constant basis function, 1 / (2 sqrt(pi))."""


def _norm(degree: int, order: int) -> float:
    """Normalization of a real harmonic over the sphere, Condon-Shortley phase left out."""
    ratio = math.factorial(degree - order) / math.factorial(degree + order)
    return math.sqrt((2 if order else 1) * (2 * degree + 1) / (4 * math.pi) * ratio)


def _legendre_over_sin(degree: int, z: Tensor) -> list[list[Tensor]]:
    """P[n][m](z) / sin(theta)^m for 0 <= m <= n <= degree: polynomials in z, finite at the poles.

    Source: the recurrences of the associated Legendre functions, with (-1)^m left out:
    P[m][m] = (2m - 1)!!, (n - m) P[n][m] = (2n - 1) z P[n-1][m] - (n + m - 1) P[n-2][m].
    """
    p: list[list[Tensor]] = []
    for n in range(degree + 1):
        row = []
        for m in range(n + 1):
            if n == m:
                row.append(torch.full_like(z, float(math.prod(range(1, 2 * m, 2)))))
            elif n == m + 1:
                row.append((2 * m + 1) * z * p[n - 1][m])
            else:
                two_below = (n + m - 1) * p[n - 2][m]
                row.append(((2 * n - 1) * z * p[n - 1][m] - two_below) / (n - m))
        p.append(row)
    return p


def sh_basis(degree: int, dirs: Float[Tensor, "N 3"]) -> Float[Tensor, "N K"]:
    """The K = (degree + 1)^2 real harmonics at unit directions `dirs`, K last.

    The azimuthal factors sin(theta)^m cos(m phi) and sin(theta)^m sin(m phi) are the real and
    imaginary parts of (x + i y)^m; 3DGS's sign is (-1)^m times the textbook's real harmonic
    without the Condon-Shortley phase: Y_1 = C1 (-y, z, -x).
    """
    x, y, z = dirs.unbind(-1)
    p = _legendre_over_sin(degree, z)
    real, imag = [torch.ones_like(x)], [torch.zeros_like(x)]
    for _ in range(degree):
        a, b = real[-1], imag[-1]
        real.append(x * a - y * b)
        imag.append(x * b + y * a)
    columns = []
    for n in range(degree + 1):
        for m in range(-n, n + 1):
            a = abs(m)
            factor = (-1) ** a * _norm(n, a)
            columns.append(factor * p[n][a] * (imag[a] if m < 0 else real[a]))
    return torch.stack(columns, dim=-1)
