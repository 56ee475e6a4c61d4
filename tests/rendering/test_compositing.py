"""Layers over one another."""

import torch

from desplat_ns.rendering.compositing import (
    composite_alpha,
    composite_color,
    in_range,
    over_background,
)


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
