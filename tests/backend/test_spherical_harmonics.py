from __future__ import annotations

import pytest
import torch
from gsplat.cuda._torch_impl import _eval_sh_bases_fast

from desplat_ns.backend.spherical_harmonics import MAX_DEGREE, sh_basis
from tests.backend import reference

EPS = 100 * torch.finfo(torch.float64).eps
"""Fewer than 50 rounded operations on numbers of at most 10."""


def directions(count: int = 200) -> torch.Tensor:
    rng = torch.Generator().manual_seed(0)
    d = torch.randn(count, 3, generator=rng, dtype=torch.float64)
    return torch.nn.functional.normalize(d, dim=-1)


@pytest.mark.parametrize("degree", range(MAX_DEGREE + 1))
def test_the_basis_is_the_textbooks_table_and_gsplats(degree):
    d = directions()
    assert (sh_basis(degree, d) - reference.real_sh(degree, d)).abs().max() < EPS
    theirs = _eval_sh_bases_fast((degree + 1) ** 2, d)
    assert (sh_basis(degree, d) - theirs).abs().max() < EPS


def test_gradients_are_those_of_finite_differences_and_finite_at_the_poles():
    poles = torch.tensor([[0.0, 0, 1], [0, 0, -1], [0, 1, 0], [1, 0, 0]], dtype=torch.float64)
    d = torch.cat([directions(5), poles]).requires_grad_()
    assert torch.autograd.gradcheck(lambda d: sh_basis(4, d), (d,), fast_mode=True)
