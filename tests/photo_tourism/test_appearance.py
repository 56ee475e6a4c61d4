"""Toning of colours: Eq. 6-7 in float64, through spherical harmonics, the identity at the start."""

import copy
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch.autograd import gradcheck

from desplat_ns.backend.spherical_harmonics import C0, sh_basis
from desplat_ns.photo_tourism import appearance
from desplat_ns.photo_tourism.appearance import (
    AffineAppearance,
    ShAppearance,
    fourier_features,
    toned_coefficients,
    toned_color,
)
from desplat_ns.photo_tourism.config import AppearanceConfig, has_bfloat16

SMALL = AppearanceConfig(embedding_dim=5, fourier_frequencies=2, hidden_width=7, mlp_scale=1.0)
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
        color = torch.einsum("k,nkc->nc", direction, toned) + 0.5
        torch.testing.assert_close(color, toned_color(plain, gamma, beta), rtol=0, atol=1e-12)


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


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_the_first_step_of_adam_moves_all_tones_by_its_rate_times_the_scale(scale):
    """Adam's first step is as long as its rate; the weights before the last bias are still 0."""
    model = AffineAppearance(replace(SMALL, mlp_scale=scale)).double()
    inputs = numbers(5), numbers(NUM, FEATURES, seed=1), numbers(NUM, 3, seed=2)
    optimizer = torch.optim.Adam([model.head.bias], lr=5e-4, eps=1e-15)
    beta, gamma = model.tones(*inputs)
    assert (beta == 0).all() and (gamma == 1).all()
    (beta - gamma).sum().backward()
    optimizer.step()
    beta, gamma = model.tones(*inputs)
    moved = torch.full((NUM, 3), 5e-4 * scale, dtype=torch.float64)
    torch.testing.assert_close(beta, -moved, rtol=1e-9, atol=0)
    torch.testing.assert_close(gamma - 1, moved, rtol=1e-9, atol=0)


def test_sizes_of_b3():
    model = AffineAppearance(AppearanceConfig())
    shapes = [tuple(p.shape) for n, p in model.named_parameters() if n.endswith("weight")]
    assert shapes == [(128, 32 + 24 + 3), (128, 128), (6, 128)]


def test_the_sh_model_adds_up_to_the_active_degree():
    model = trained(ShAppearance(SMALL, 3))
    coefficients = numbers(NUM, BASES, 3)
    lit = model(numbers(5), numbers(NUM, FEATURES, seed=1), coefficients, 1)
    assert torch.equal(lit[:, 4:], coefficients[:, 4:])
    assert (lit[:, :4] != coefficients[:, :4]).all()


def test_fourier_features_of_known_points():
    """Centred, so that the mean is 0; the scale is that of the 97th of 100 points."""
    points = torch.zeros(101, 3, dtype=torch.float64)
    points[:, 0] = torch.linspace(-1, 1, 101, dtype=torch.float64)
    features = fourier_features(points, 4)
    assert features.shape == (101, 24)
    scale = points[:, 0].abs().sort().values[97]
    x = points[:, 0] / scale
    for place, turns in enumerate((1, 2, 4, 8)):
        torch.testing.assert_close(features[:, place], torch.sin(torch.pi * turns * x))
        torch.testing.assert_close(features[:, 12 + place], torch.cos(torch.pi * turns * x))


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
    lit = model(*inputs, 3)
    assert lit.isfinite().all()
    assert all(g.isfinite().all() for g in torch.autograd.grad(lit.square().mean(), inputs))


# --- the MLP by blocks of rows ----------------------------------------------------------------

MANY = 50
"""Rows of `outputs_and_gradients`: several blocks of 16, the last one shorter."""


def outputs_and_gradients(
    model: AffineAppearance, dtype: torch.dtype, rows: torch.Tensor | None = None
) -> list[torch.Tensor]:
    """beta and gamma - 1 [N, 6], and the gradients of their sum by inputs and parameters."""
    shapes = ((5,), (MANY, FEATURES), (MANY, 3))
    own = [numbers(*shape, seed=i).to(dtype).requires_grad_() for i, shape in enumerate(shapes)]
    embedding, features, zeroth = own
    beta, gamma = model.to(dtype).tones(embedding, features, zeroth, rows)
    out = torch.cat([beta, gamma - 1], dim=1)
    leaves = [*own, *model.parameters()]
    return [out, *torch.autograd.grad(out, leaves, torch.ones_like(out))]


def absolute_outputs_and_gradients(model: AffineAppearance) -> list[torch.Tensor]:
    """The same of absolute inputs and weights, so that all units are on and nothing cancels."""
    model = copy.deepcopy(model).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.abs_()
    shapes = ((5,), (MANY, FEATURES), (MANY, 3))
    own = [numbers(*shape, seed=i).abs().requires_grad_() for i, shape in enumerate(shapes)]
    out = model.head(model.body(torch.cat([own[0].expand(MANY, -1), *own[1:]], dim=1)))
    leaves = [*own, *model.parameters()]
    return [out, *torch.autograd.grad(out, leaves, torch.ones_like(out))]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_blocks_are_off_by_rounding_from_all_rows_together_in_float64(monkeypatch, dtype):
    """Every number is a sum of products along the network's paths. Rounding is at most a unit in
    the last place for each operation on a path, of the same sum with absolute values; gamma is
    rounded once more, at 1 + beta's size."""
    model = trained(AffineAppearance(SMALL))
    exact = outputs_and_gradients(copy.deepcopy(model), torch.float64)
    bounds = absolute_outputs_and_gradients(model)
    monkeypatch.setitem(appearance.ROWS_AT_ONCE, "cpu", 16)
    operations = 2 * (5 + FEATURES + 3 + 7 + 7 + 6 + MANY)
    unit = torch.finfo(dtype).eps
    for ours, wanted, bound in zip(outputs_and_gradients(model, dtype), exact, bounds, strict=True):
        assert ((ours - wanted).abs() <= operations * unit * (bound + 1)).all()


def test_the_same_bits_every_time():
    model = trained(AffineAppearance(SMALL))
    first, again = (outputs_and_gradients(model, torch.float32) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))


def test_rows_that_are_left_out_get_no_gradient(monkeypatch):
    monkeypatch.setitem(appearance.ROWS_AT_ONCE, "cpu", 2)
    rows, others = torch.tensor([3, 4, 8, 40]), torch.ones(MANY, dtype=torch.bool)
    others[rows] = False
    model = trained(AffineAppearance(SMALL))
    _, _, *by_own = outputs_and_gradients(model, torch.float64, rows)[:4]
    for gradient in by_own:
        assert (gradient[others] == 0).all() and (gradient[rows] != 0).any(1).all()


def test_a_view_without_gaussians_gets_zeros():
    model = trained(AffineAppearance(SMALL))
    out, *gradients = outputs_and_gradients(model, torch.float64, torch.zeros(0, dtype=torch.long))
    assert out.shape == (MANY, 6)
    assert all((value == 0).all() for value in (out, *gradients))


def test_bfloat16_is_off_by_its_rounding_and_sums_gradients_in_float32(monkeypatch):
    """Each layer rounds its input, weights and output to 8 bits; errors pass on by the layers'
    absolute weights. In bfloat16 a sum of many blocks' gradients would stand still: here each of
    1,024 blocks adds the same to the last bias."""
    monkeypatch.setattr(appearance, "has_bfloat16", lambda device: True)  # torch rounds alike
    model = trained(AffineAppearance(replace(SMALL, mlp_dtype="bfloat16"))).float()
    embedding, own = numbers(5).float(), numbers(2048, FEATURES + 3, seed=1).float()
    monkeypatch.setitem(appearance.ROWS_AT_ONCE, "cpu", 2)
    monkeypatch.setattr(appearance, "MORE_IN_BFLOAT16", 1)
    beta, gamma = model.tones(embedding, own[:, :FEATURES], own[:, FEATURES:])
    h = torch.cat([embedding.expand(len(own), -1), own], dim=1).double()
    error, unit = torch.zeros_like(h), 2.0**-8
    for layer in (model.body[0], model.body[2], model.head):
        w, b = layer.weight.double(), layer.bias.double()
        error = error @ w.abs().T + 4 * unit * (h.abs() @ w.abs().T + b.abs())
        h = h @ w.T + b
        h = h if layer is model.head else h.relu()
    off = (torch.cat([beta, gamma - 1], dim=1) - h).abs()
    assert (off <= error).all() and off.max() > unit**2
    (by_bias,) = torch.autograd.grad(beta.sum(), model.head.bias)
    assert by_bias.dtype == torch.float32 and by_bias.tolist() == [2048.0] * 3 + [0.0] * 3


def test_a_processor_without_bfloat16_goes_on_in_float32(monkeypatch):
    model = trained(AffineAppearance(SMALL))
    wanted = outputs_and_gradients(model, torch.float32)
    model.in_bfloat16 = True
    monkeypatch.setattr(appearance, "has_bfloat16", lambda device: False)
    computed = outputs_and_gradients(model, torch.float32)
    assert all(torch.equal(a, b) for a, b in zip(computed, wanted, strict=True))


@pytest.mark.parametrize("which", ["_is_avx512_bf16_supported", "_is_amx_tile_supported"])
def test_either_set_of_instructions_multiplies_in_bfloat16(monkeypatch, which):
    for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported"):
        monkeypatch.setattr(torch.cpu, name, lambda here=name == which: here)
    assert has_bfloat16.__wrapped__("cpu") and not has_bfloat16("meta")
