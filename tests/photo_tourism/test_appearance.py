"""Toning of colours: Eq. 6-7 in float64, through spherical harmonics, the identity at the start."""

from typing import Any

import pytest
import torch
from torch.autograd import gradcheck

from desplat_ns.backend.spherical_harmonics import C0, sh_basis
from desplat_ns.photo_tourism.appearance import (
    AffineAppearance,
    ShAppearance,
    fourier_features,
    toned_coefficients,
    toned_color,
)
from desplat_ns.photo_tourism.config import AppearanceConfig

SMALL = AppearanceConfig(embedding_dim=5, fourier_frequencies=2, hidden_width=7)
NUM, BASES, FEATURES = 6, 16, 12


def numbers(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def trained(model: Any) -> Any:
    """With heads that are no longer zero."""
    model.double()
    for parameter in model.parameters():
        parameter.data.copy_(0.3 * numbers(*parameter.shape, seed=3))
    return model


def test_the_toned_colour_is_an_affine_map():
    color, gamma, beta = numbers(NUM, 3), numbers(NUM, 3, seed=1), numbers(NUM, 3, seed=2)
    assert torch.equal(toned_color(color, gamma, beta), gamma * color + beta)


def test_toned_coefficients_evaluate_to_the_toned_colour_in_every_direction():
    coefficients = numbers(NUM, BASES, 3)
    gamma, beta = numbers(NUM, 3, seed=1), numbers(NUM, 3, seed=2)
    toned = toned_coefficients(coefficients, gamma, beta)
    directions = torch.nn.functional.normalize(numbers(50, 3, seed=4), dim=-1)
    basis = sh_basis(3, directions)
    for direction in basis:
        plain = torch.einsum("k,nkc->nc", direction, coefficients) + 0.5
        seen = torch.einsum("k,nkc->nc", direction, toned) + 0.5
        torch.testing.assert_close(seen, toned_color(plain, gamma, beta), rtol=0, atol=1e-12)


def test_gradients_of_the_toning():
    inputs = [
        numbers(NUM, 4, 3).requires_grad_(),
        numbers(NUM, 3, seed=1).requires_grad_(),
        numbers(NUM, 3, seed=2).requires_grad_(),
    ]
    assert gradcheck(toned_coefficients, inputs)


@pytest.mark.parametrize("make", [AffineAppearance, lambda c: ShAppearance(c, 3)])
def test_at_the_start_no_colour_changes(make):
    model = make(SMALL)
    coefficients = numbers(NUM, BASES, 3).float()
    embedding, features = numbers(5, seed=1).float(), numbers(NUM, FEATURES, seed=2).float()
    torch.testing.assert_close(model(embedding, features, coefficients, 3), coefficients)


@pytest.mark.parametrize("make", [AffineAppearance, lambda c: ShAppearance(c, 3)])
def test_gradients_of_the_networks(make):
    model = trained(make(SMALL))
    inputs = [
        numbers(5, seed=1).requires_grad_(),
        numbers(NUM, FEATURES, seed=2).requires_grad_(),
        numbers(NUM, BASES, 3).requires_grad_(),
    ]
    assert gradcheck(lambda e, z, c: model(e, z, c, 3), inputs)
    loss = model(*inputs, 3).square().sum()
    assert all(g.abs().max() > 0 for g in torch.autograd.grad(loss, inputs))


def test_eq_6_reads_embedding_features_and_the_zeroth_coefficient():
    """The split first layer equals the MLP on the concatenated inputs."""
    model = trained(AffineAppearance(SMALL))
    embedding, features, zeroth = (
        numbers(5),
        numbers(NUM, FEATURES, seed=1),
        numbers(NUM, 3, seed=2),
    )
    row = torch.cat([embedding.expand(NUM, -1), features, zeroth], dim=1)
    expected = model.head(model.body(row))
    beta, gamma = model.tones(embedding, features, zeroth)
    torch.testing.assert_close(beta, expected[:, :3])
    torch.testing.assert_close(gamma, 1 + expected[:, 3:])


def test_sizes_of_b3():
    model = AffineAppearance(AppearanceConfig())
    shapes = [tuple(p.shape) for n, p in model.named_parameters() if n.endswith("weight")]
    assert shapes == [(128, 32 + 24 + 3), (128, 128), (6, 128)]


def test_the_sh_model_adds_up_to_the_active_degree():
    model = trained(ShAppearance(SMALL, 3))
    coefficients = numbers(NUM, BASES, 3)
    seen = model(numbers(5), numbers(NUM, FEATURES, seed=1), coefficients, 1)
    assert torch.equal(seen[:, 4:], coefficients[:, 4:])
    assert (seen[:, :4] != coefficients[:, :4]).all()


def test_fourier_features_of_known_points():
    """Centred, so that the mean is 0; the scale is that of the 97th of 100 points."""
    points = torch.zeros(101, 3, dtype=torch.float64)
    points[:, 0] = torch.linspace(-1, 1, 101, dtype=torch.float64)
    features = fourier_features(points, 4)
    assert features.shape == (101, 24)
    scale = points[:, 0].abs().sort().values[97]
    x = points[:, 0] / scale
    for m in range(1, 5):
        torch.testing.assert_close(features[:, m - 1], torch.sin(torch.pi * 2**m * x))
        torch.testing.assert_close(features[:, 12 + m - 1], torch.cos(torch.pi * 2**m * x))


def test_fourier_features_of_coincident_points_are_finite():
    assert fourier_features(torch.ones(4, 3), 4).isfinite().all()


def test_fourier_features_of_points_at_the_end_of_float32_are_finite():
    points = torch.rand(50, 3)
    points[0], points[1] = 3e38, -3e38
    assert fourier_features(points, 4).isfinite().all()
    assert fourier_features(torch.tensor([[1e38] * 3, [2e38] * 3, [3e38] * 3]), 4).isfinite().all()


def test_the_constant_of_the_basis():
    basis = sh_basis(0, torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    assert float(basis[0, 0]) == pytest.approx(C0)


@pytest.mark.parametrize("make", [AffineAppearance, lambda c: ShAppearance(c, 3)])
def test_the_networks_work_on_the_rows_that_they_are_given(make):
    model = trained(make(SMALL))
    inputs, rows = (numbers(5), numbers(NUM, FEATURES, seed=1)), torch.tensor([1, 4, 5])
    coefficients = numbers(NUM, BASES, 3, seed=2)
    if isinstance(model, AffineAppearance):
        whole = torch.cat(model.tones(*inputs, coefficients[:, 0]), dim=1)
        some = torch.cat(model.tones(*inputs, coefficients[:, 0], rows), dim=1)
        left_alone = torch.tensor([0.0, 0, 0, 1, 1, 1]).double().expand(NUM, 6)
    else:
        whole, some = model(*inputs, coefficients, 3), model(*inputs, coefficients, 3, rows)
        left_alone = coefficients
    others = torch.tensor([0, 2, 3])
    torch.testing.assert_close(some[rows], whole[rows])
    assert torch.equal(some[others], left_alone[others])


@pytest.mark.parametrize("make", [AffineAppearance, lambda c: ShAppearance(c, 3)])
def test_huge_embeddings_give_finite_colours_and_gradients(make):
    model = trained(make(SMALL)).float()
    inputs = [
        torch.full((5,), 1e4, requires_grad=True),
        numbers(NUM, FEATURES, seed=2).float().requires_grad_(),
        numbers(NUM, BASES, 3).float().requires_grad_(),
    ]
    seen = model(*inputs, 3)
    assert seen.isfinite().all()
    assert all(g.isfinite().all() for g in torch.autograd.grad(seen.square().mean(), inputs))
