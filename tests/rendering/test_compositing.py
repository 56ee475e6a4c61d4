"""Layers over one another."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.rendering.compositing import (
    composite_alpha,
    composite_color,
    in_range,
    over_background,
)

EPS = torch.finfo(torch.float64).eps


@st.composite
def pixels(draw, channels=1):
    values = draw(st.lists(st.floats(0, 1), min_size=2 * channels, max_size=2 * channels))
    return torch.tensor(values, dtype=torch.float64).reshape(2, 1, channels)


def pixel(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64).reshape(1, 1, -1)


def test_a_value_worked_out_by_hand():
    # A distractor of colour (1, 0, 0) at alpha 0.25 over a static pixel of colour (0, 1, 0) at 0.5,
    # over white: 0.25 red + 0.75 * 0.5 green + 0.75 * 0.5 white.
    rgb_d, alpha_d = pixel(0.25, 0, 0), pixel(0.25)
    rgb_s, alpha_s = pixel(0, 0.5, 0), pixel(0.5)
    both = composite_color(rgb_d, alpha_d, rgb_s)
    alpha = composite_alpha(alpha_d, alpha_s)
    assert torch.equal(both, pixel(0.25, 0.375, 0))
    assert torch.equal(alpha, pixel(0.625))
    assert torch.equal(over_background(both, alpha, pixel(1, 1, 1)), pixel(0.625, 0.75, 0.375))


@given(alpha_d=pixels(), alpha_s=pixels())
def test_a_second_layer_never_makes_a_pixel_clearer(alpha_d, alpha_s):
    alpha = composite_alpha(alpha_d, alpha_s)
    assert (alpha >= torch.maximum(alpha_d, alpha_s) - 4 * EPS).all()
    assert (alpha <= 1 + 4 * EPS).all()


@given(rgb_s=pixels(3), alpha_s=pixels())
def test_an_empty_distractor_layer_changes_nothing(rgb_s, alpha_s):
    nothing = torch.zeros_like(alpha_s)
    assert torch.equal(composite_color(torch.zeros_like(rgb_s), nothing, rgb_s), rgb_s)
    assert torch.equal(composite_alpha(nothing, alpha_s), alpha_s)


@given(rgb_d=pixels(3), rgb_s=pixels(3))
def test_an_opaque_distractor_hides_the_scene(rgb_d, rgb_s):
    opaque = torch.ones(2, 1, 1, dtype=torch.float64)
    assert torch.equal(composite_color(rgb_d, opaque, rgb_s), rgb_d)


def test_gradients_agree_with_finite_differences():
    generator = torch.Generator().manual_seed(0)
    shapes = [(2, 3, 3), (2, 3, 1), (2, 3, 3), (2, 3, 1), (3,)]
    inputs = [
        torch.rand(shape, generator=generator, dtype=torch.float64, requires_grad=True)
        for shape in shapes
    ]

    def final(rgb_d, alpha_d, rgb_s, alpha_s, background):
        both = composite_color(rgb_d, alpha_d, rgb_s)
        return over_background(both, composite_alpha(alpha_d, alpha_s), background)

    assert torch.autograd.gradcheck(final, inputs)


def test_colours_are_cut_to_the_range_and_have_a_gradient_within():
    colors = torch.tensor([[[-1.0, 0.0, 0.5], [1.0, 1.5, 0.25]]], requires_grad=True)
    cut = in_range(colors)
    assert cut.flatten().tolist() == [0.0, 0.0, 0.5, 1.0, 1.0, 0.25]
    (slope,) = torch.autograd.grad(cut.sum(), colors)
    assert slope.flatten().tolist() == [0, 0, 1, 0, 0, 1]
