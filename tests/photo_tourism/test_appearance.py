"""Toning of colours: Eq. 6-7 in float64, through spherical harmonics, the identity at the start."""

from typing import Any

import pytest
import torch
from torch.autograd import gradcheck

from desplat_ns.photo_tourism import appearance
from desplat_ns.photo_tourism.appearance import (
    AffineAppearance,
    ShAppearance,
    fourier_features,
)
from desplat_ns.photo_tourism.config import AppearanceConfig

NETWORKS = pytest.mark.parametrize("make", [AffineAppearance, lambda c: ShAppearance(c, 3)])
UNSCALED = AppearanceConfig(mlp_scale=1.0)
NUM, BASES, FEATURES = 6, 16, 24


def numbers(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def trained(model: Any) -> Any:
    """With heads that are no longer zero."""
    model.double()
    for parameter in model.parameters():
        parameter.data.copy_(0.3 * numbers(*parameter.shape, seed=3))
    return model


@NETWORKS
def test_gradients_of_the_networks(make):
    model = trained(make(UNSCALED))
    inputs = [
        numbers(32, seed=1).requires_grad_(),
        numbers(NUM, FEATURES, seed=2).requires_grad_(),
        numbers(NUM, BASES, 3).requires_grad_(),
    ]
    assert gradcheck(lambda e, z, c: model(e, z, c, 3), inputs)
    loss = model(*inputs, 3).square().sum()
    assert all(g.abs().max() > 0 for g in torch.autograd.grad(loss, inputs))


def test_eq_6_reads_embedding_features_and_the_zeroth_coefficient():
    """The split first layer equals the MLP on the concatenated inputs."""
    model = trained(AffineAppearance(UNSCALED))
    embedding, features = numbers(32), numbers(NUM, FEATURES, seed=1)
    zeroth = numbers(NUM, 3, seed=2)
    row = torch.cat([embedding.expand(NUM, -1), features, zeroth], dim=1)
    expected = model.head(model.body(row))
    beta, gamma = model.tones(embedding, features, zeroth)
    torch.testing.assert_close(beta, expected[:, :3])
    torch.testing.assert_close(gamma, 1 + expected[:, 3:])


def test_the_sh_model_adds_up_to_the_active_degree():
    model = trained(ShAppearance(UNSCALED, 3))
    coefficients = numbers(NUM, BASES, 3)
    lit = model(numbers(32), numbers(NUM, FEATURES, seed=1), coefficients, 1)
    assert torch.equal(lit[:, 4:], coefficients[:, 4:])
    assert (lit[:, :4] != coefficients[:, :4]).all()


def test_fourier_features_of_known_points():
    """Centred, so that the mean is 0; the scale is that of the 97th of 100 points."""
    points = torch.zeros(101, 3, dtype=torch.float64)
    points[:, 0] = torch.linspace(-1, 1, 101, dtype=torch.float64)
    features = fourier_features(points)
    assert features.shape == (101, 24)
    scale = points[:, 0].abs().sort().values[97]
    x = points[:, 0] / scale
    for place, turns in enumerate((1, 2, 4, 8)):
        torch.testing.assert_close(features[:, place], torch.sin(torch.pi * turns * x))
        torch.testing.assert_close(features[:, 12 + place], torch.cos(torch.pi * turns * x))


def test_fourier_features_of_coincident_points_and_at_the_end_of_float32_are_finite():
    points = torch.rand(50, 3)
    points[0], points[1] = 3e38, -3e38
    assert fourier_features(points).isfinite().all()
    assert fourier_features(torch.tensor([[1e38] * 3, [2e38] * 3, [3e38] * 3])).isfinite().all()
    assert fourier_features(torch.ones(4, 3)).isfinite().all()


def test_blocks_of_rows_give_what_all_together_do_and_what_is_left_out_gets_no_gradient(
    monkeypatch,
):
    """beta and gamma - 1, and the gradients of their sum by inputs and parameters: sums of some 100
    products of numbers near 1, in another order."""
    model, count = trained(AffineAppearance(UNSCALED)), 50
    rows, others = torch.tensor([3, 4, 8, 40]), torch.ones(count, dtype=torch.bool)
    others[rows] = False

    def outputs_and_gradients(rows: torch.Tensor | None) -> list[torch.Tensor]:
        shapes = ((32,), (count, FEATURES), (count, 3))
        own = [numbers(*shape, seed=i).requires_grad_() for i, shape in enumerate(shapes)]
        beta, gamma = model.tones(*own, rows)
        out = torch.cat([beta, gamma - 1], dim=1)
        return [out, *torch.autograd.grad(out.sum(), [*own, *model.parameters()])]

    together = outputs_and_gradients(None)
    for size in (16, 2):  # of the last ones shorter
        monkeypatch.setitem(appearance.ROWS_AT_ONCE, "cpu", size)
        for ours, wanted in zip(outputs_and_gradients(None), together, strict=True):
            torch.testing.assert_close(ours, wanted, rtol=1e-12, atol=1e-12)
    some = outputs_and_gradients(rows)
    for ours, wanted in zip((some[0], *some[2:4]), (together[0], *together[2:4]), strict=True):
        torch.testing.assert_close(ours[rows], wanted[rows])
        assert (ours[others] == 0).all()
    assert all((value == 0).all() for value in outputs_and_gradients(rows[:0]))
