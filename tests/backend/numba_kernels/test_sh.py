from __future__ import annotations

import math

import pytest
import torch

from desplat_ns.backend.numba_kernels.sh import BATCH, EvaluateColors, sh_terms
from desplat_ns.backend.spherical_harmonics import sh_basis
from tests.backend.reference import real_sh

EPS = torch.finfo(torch.float32).eps
CENTER = torch.tensor([0.3, -0.2, 0.5])


def random_colors(count: int, bases: int):
    rng = torch.Generator().manual_seed(bases)
    means = torch.randn(count, 3, generator=rng) + 2
    values = torch.randn(count, bases, 3, generator=rng) * 0.4
    return means.requires_grad_(), values.requires_grad_()


@pytest.mark.parametrize("degree", range(5))
def test_the_terms_are_the_textbooks_table(degree):
    directions = torch.nn.functional.normalize(torch.randn(50, 3, dtype=torch.float64), dim=-1)
    places, coefficients = sh_terms(degree)
    basis = torch.zeros(50, (degree + 1) ** 2, dtype=torch.float64)
    for (k, *powers), c in zip(places.tolist(), coefficients.tolist(), strict=True):
        basis[:, k] += c * (directions ** torch.tensor(powers)).prod(-1)
    # Up to five terms, whose coefficients (< 20) are rounded to float32.
    assert (basis - real_sh(degree, directions)).abs().max() <= 5 * 20 * EPS


def test_a_constant_and_a_linear_harmonic_as_worked_out_by_hand():
    means = torch.tensor([[0.3, -0.2, 3.5]])  # straight ahead: d = (0, 0, 1)
    values = torch.zeros(1, 4, 3)
    values[0, 0], values[0, 2] = torch.tensor([1.0, 0.0, -9.0]), torch.tensor([0.0, 1.0, 0.0])
    got = EvaluateColors.apply(means, values, torch.ones(1, dtype=torch.int32), CENTER, 1)
    c0, c1 = 0.5 / math.sqrt(math.pi), math.sqrt(3 / (4 * math.pi))
    assert got[0].tolist() == pytest.approx([c0 + 0.5, c1 + 0.5, 0], abs=4 * EPS)


@pytest.mark.parametrize(("degree", "bases"), [(0, 1), (1, 16), (2, 9), (3, 16), (4, 25)])
@pytest.mark.parametrize("count", [1, 2 * BATCH + 3])
def test_colours_and_gradients_agree_with_float64(degree, bases, count):
    means, values = random_colors(count, bases)
    got = EvaluateColors.apply(means, values, torch.ones(count, dtype=torch.int32), CENTER, degree)
    exact = [t.detach().double().requires_grad_() for t in (means, values)]
    directions = torch.nn.functional.normalize(exact[0] - CENTER.double(), dim=-1)
    basis = sh_basis(degree, directions)
    want = (torch.einsum("nk,nkc->nc", basis, exact[1][:, : basis.shape[1]]) + 0.5).clamp(min=0)
    # Sums of 25 products, of polynomials of degree 4.
    allowed = 100 * EPS
    assert (got - want).abs().max() <= allowed * want.abs().max()
    factor = torch.randn(count, 3)
    # Colours cut off at 0 have a kink there.
    factor = factor * ((want.detach() > 1e-4) | (want.detach() == 0))
    (got * factor).sum().backward()
    ((want * factor).sum() + 0 * exact[0].sum()).backward()
    assert values.grad is not None and means.grad is not None
    assert exact[0].grad is not None and exact[1].grad is not None
    assert (values.grad - exact[1].grad).abs().max() <= allowed * exact[1].grad.abs().max()
    scale = exact[0].grad.abs().max()
    assert (means.grad - exact[0].grad).abs().max() <= allowed * max(scale, 1)


def test_culled_ones_get_zeros_whatever_they_hold():
    means, values = random_colors(3, 4)
    with torch.no_grad():
        values[1], means[2] = math.nan, math.inf
    radii = torch.tensor([1, 0, 0], dtype=torch.int32)
    got = EvaluateColors.apply(means, values, radii, CENTER, 1)
    assert (got[1:] == 0).all()
    assert (got[0] > 0).any()
    got.backward(torch.full_like(got, 2.0))
    assert values.grad is not None and means.grad is not None
    assert (values.grad[1:] == 0).all()
    assert (means.grad[1:] == 0).all()
    assert values.grad[0].isfinite().all()
