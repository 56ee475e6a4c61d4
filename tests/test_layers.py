"""Layers over one another, and the images that come out of the model."""

import pytest
import torch

from desplat_ns.backend.protocol import Rendering
from desplat_ns.layers import (
    composite_alpha,
    in_range,
    layered_outputs,
    over_background,
    static_outputs,
)

BLUE = torch.tensor([0.0, 0.0, 1.0])


def pixel(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64).reshape(1, 1, -1)


def test_a_value_worked_out_by_hand():
    # A distractor of colour (1, 0, 0) at alpha 0.25 over a static pixel of colour (0, 1, 0) at 0.5,
    # over white: 0.25 red + 0.75 * 0.5 green + 0.75 * 0.5 white.
    rgb_d, alpha_d = pixel(0.25, 0, 0), pixel(0.25)
    rgb_s, alpha_s = pixel(0, 0.5, 0), pixel(0.5)
    both = over_background(rgb_d, alpha_d, rgb_s)
    alpha = composite_alpha(alpha_d, alpha_s)
    assert torch.equal(both, pixel(0.25, 0.375, 0))
    assert torch.equal(alpha, pixel(0.625))
    assert torch.equal(over_background(both, alpha, pixel(1, 1, 1)), pixel(0.625, 0.75, 0.375))


def test_colours_are_cut_to_the_range_and_have_a_gradient_within():
    colors = torch.tensor([[[-1.0, 0.0, 0.5], [1.0, 1.5, 0.25]]], requires_grad=True)
    cut = in_range(colors)
    assert cut.flatten().tolist() == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0, 0.25], abs=1e-36)
    (slope,) = torch.autograd.grad(cut.sum(), colors)
    assert slope.flatten().tolist() == [0, 1, 1, 0, 0, 1], "black can become lighter"


def layer(rgb: list[float], alpha: list[float], depth: list[float] | None = None) -> Rendering:
    """A layer of one row: each pixel's colour is `rgb` times its alpha."""
    a = torch.tensor(alpha).reshape(1, -1, 1)
    d = None if depth is None else torch.tensor(depth).reshape(1, -1, 1)
    return Rendering(torch.tensor(rgb) * a, a, d, torch.zeros(1, 0, 2), torch.zeros(0).int())


def over_blue(static: Rendering) -> torch.Tensor:
    return over_background(static.rgb, static.alpha, BLUE)


def outputs_of(static: Rendering) -> dict[str, torch.Tensor]:
    return static_outputs(static, over_blue(static), BLUE)


def test_the_distractors_and_the_composite_are_outputs_of_their_own():
    static, distractor = layer([0, 1.0, 0], [1.0, 0.5]), layer([1.0, 0, 0], [0.25, 0.75])
    outputs = layered_outputs(over_blue(static), outputs_of(static)["rgb"], distractor)
    assert torch.equal(outputs["rgb_distractor"], distractor.rgb)
    # 0.25 red + 0.75 green; 0.75 red + 0.25 * (0.5 green + 0.5 blue).
    expected = torch.tensor([[[0.25, 0.75, 0], [0.75, 0.125, 0.125]]])
    assert torch.equal(outputs["rgb_composite"], expected)
    assert outputs["distractor_mask"].flatten().tolist() == [False, True]


def test_the_static_scene_lies_over_the_background_and_where_nothing_is_depth_is_the_farthest():
    outputs = outputs_of(layer([2.0, 0, 0], [0.0, 0.25, 1.0], depth=[0.0, 2.0, 7.0]))
    expected = torch.tensor([[[0, 0, 1.0], [0.5, 0, 0.75], [1.0, 0, 0]]])  # cut off at 1
    assert torch.equal(outputs["rgb"], expected)
    assert outputs["depth"].flatten().tolist() == [7.0, 2.0, 7.0]
    assert "depth" not in outputs_of(layer([2.0, 0, 0], [1.0]))
