"""Real spherical harmonics in the sign convention of 3DGS and gsplat.

Coefficients are ordered (degree, order) with order from -degree to +degree: K = (degree + 1)^2.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

MAX_DEGREE = 4

C0 = 0.5 / math.sqrt(math.pi)
"""The constant basis function, 1 / (2 sqrt(pi))."""


def norm(degree: int, order: int) -> float:
    """Normalization of a real harmonic over the sphere, times 3DGS's sign, (-1)^order."""
    ratio = math.factorial(degree - order) / math.factorial(degree + order)
    size = math.sqrt((2 if order else 1) * (2 * degree + 1) / (4 * math.pi) * ratio)
    return (-1) ** order * size


def legendre(degree: int, order: int) -> dict[int, float]:
    """P(z) / sin(theta)^order of an associated Legendre function P, z being cos(theta), without the
    Condon-Shortley phase: coefficients by powers of z. Source: Rodrigues' formula, term by term."""
    terms = {}
    for j in range((degree - order) // 2 + 1):
        power = degree - 2 * j
        c = (-1.0) ** j * math.comb(degree, j) * math.comb(2 * (degree - j), degree) / 2.0**degree
        terms[power - order] = c * math.perm(power, order)
    return terms


def sh_basis(degree: int, dirs: Float[Tensor, "N 3"]) -> Float[Tensor, "N K"]:
    """The K = (degree + 1)^2 real harmonics at unit directions. The azimuthal factors
    sin(theta)^m cos(m phi) and sin(theta)^m sin(m phi) are the real and imaginary parts of
    (x + i y)^m; 3DGS's sign is (-1)^m times the textbook's real harmonic without the
    Condon-Shortley phase: Y_1 = C1 (-y, z, -x)."""
    x, y, z = dirs.unbind(-1)
    real, imag = [torch.ones_like(x)], [torch.zeros_like(x)]
    powers: list[Tensor | float] = [1.0]
    for _ in range(degree):
        powers.append(z * powers[-1])
        a, b = real[-1], imag[-1]
        real.append(x * a - y * b)
        imag.append(x * b + y * a)
    columns = []
    for n in range(degree + 1):
        polar = [
            sum(norm(n, m) * c * powers[k] for k, c in sorted(legendre(n, m).items()))
            for m in range(n + 1)
        ]
        columns += [polar[-m] * imag[-m] for m in range(-n, 0)]
        columns += [polar[m] * real[m] for m in range(n + 1)]
    return torch.stack(columns, dim=-1)
