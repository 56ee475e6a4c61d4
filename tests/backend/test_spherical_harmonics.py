from __future__ import annotations

import math

import pytest
import torch
from gsplat.cuda._torch_impl import _eval_sh_bases_fast

from desplat_ns.backend.spherical_harmonics import C0, MAX_DEGREE, sh_basis
from tests.backend import reference

DEGREES = range(MAX_DEGREE + 1)
EPS = 100 * torch.finfo(torch.float64).eps
"""Fewer than 50 rounded operations on numbers of at most 10."""


def directions(count: int = 200) -> torch.Tensor:
    rng = torch.Generator().manual_seed(0)
    d = torch.randn(count, 3, generator=rng, dtype=torch.float64)
    return torch.nn.functional.normalize(d, dim=-1)


def test_the_first_two_degrees_are_those_of_3dgs():
    c1 = math.sqrt(3 / (4 * math.pi))
    x, y, z = 0.6, 0.0, 0.8
    basis = sh_basis(1, torch.tensor([[x, y, z]], dtype=torch.float64))
    assert basis[0].tolist() == pytest.approx([0.28209479177387814, -c1 * y, c1 * z, -c1 * x])
    assert pytest.approx(0.28209479177387814) == C0


@pytest.mark.parametrize("degree", DEGREES)
def test_the_basis_is_the_textbooks_table(degree):
    d = directions()
    assert (sh_basis(degree, d) - reference.real_sh(degree, d)).abs().max() < EPS


@pytest.mark.parametrize("degree", DEGREES)
def test_the_basis_is_gsplats(degree):
    d = directions()
    theirs = _eval_sh_bases_fast((degree + 1) ** 2, d)
    assert (sh_basis(degree, d) - theirs).abs().max() < EPS


@pytest.mark.parametrize("degree", DEGREES)
def test_each_degree_has_the_same_power_in_every_direction(degree):
    # Unsoeld's theorem: the sum over orders of Y^2 is (2 n + 1) / (4 pi).
    band = sh_basis(degree, directions())[:, degree**2 :]
    assert band.shape[1] == 2 * degree + 1
    want = (2 * degree + 1) / (4 * math.pi)
    assert (band.square().sum(dim=-1) - want).abs().max() < EPS


def test_the_basis_is_orthonormal_over_the_sphere():
    # Gauss-Legendre in z times equal steps in the azimuth is exact up to degree 2 * 4.
    import numpy as np

    nodes, weights = (torch.from_numpy(t) for t in np.polynomial.legendre.leggauss(8))
    phi = torch.arange(16, dtype=torch.float64) * (2 * math.pi / 16)
    z, phi = (t.flatten() for t in torch.meshgrid(nodes, phi, indexing="ij"))
    s = (1 - z * z).sqrt()
    basis = sh_basis(4, torch.stack([s * phi.cos(), s * phi.sin(), z], dim=-1))
    area = weights.repeat_interleave(16)[:, None] * (2 * math.pi / 16)
    assert (basis.T @ (basis * area) - torch.eye(25, dtype=torch.float64)).abs().max() < EPS


def test_gradients_are_those_of_finite_differences_and_finite_at_the_poles():
    poles = torch.tensor([[0.0, 0, 1], [0, 0, -1], [0, 1, 0], [1, 0, 0]], dtype=torch.float64)
    d = torch.cat([directions(5), poles]).requires_grad_()
    assert torch.autograd.gradcheck(lambda d: sh_basis(4, d), (d,), fast_mode=True)
