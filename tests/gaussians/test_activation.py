"""Activations, and taking a checkpoint's number of Gaussians."""

import math

import torch
from torch import nn

from desplat_ns.gaussians.activation import (
    activate_distractors,
    activate_static,
    resize_rows,
    sigmoid,
)


def static_params(n: int = 2) -> dict[str, torch.Tensor]:
    return {
        "means": torch.arange(3.0 * n).reshape(n, 3),
        "scales": torch.full((n, 3), math.log(2.0)),
        "quats": torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        "features_dc": torch.full((n, 3), 0.5),
        "features_rest": torch.full((n, 15, 3), 0.25),
        "opacities": torch.zeros(n, 1),
    }


def test_static_values_worked_out_by_hand():
    splats = activate_static(static_params(), sh_degree=3)
    assert torch.allclose(splats.scales, torch.full((2, 3), 2.0))
    assert torch.equal(splats.opacities, torch.full((2,), 0.5))
    assert splats.colors.shape == (2, 16, 3)
    assert torch.equal(splats.colors[:, 0], torch.full((2, 3), 0.5))


def test_a_log_scale_that_overflows_has_a_finite_scale_and_no_gradient():
    """exp(100) is infinite in float32, and what is culled sends 0 back: 0 * infinity is NaN."""
    params = static_params(4)
    params["scales"] = torch.tensor([[100.0], [88.8], [40.0], [-200.0]]).repeat(1, 3)
    params["scales"].requires_grad_()
    distractors = params | {"rgbs": torch.zeros(4, 3)}
    for splats in (activate_static(params, 0), activate_distractors(distractors)):
        assert splats.scales.isfinite().all()
        (slope,) = torch.autograd.grad((splats.scales * 0).sum(), params["scales"])
        assert torch.equal(slope, torch.zeros(4, 3))


def test_distractor_colours_are_clamped_and_a_colour_on_the_border_still_learns():
    rgbs = torch.tensor([[-0.5, 0.0, 0.25], [1.0, 1.5, 0.75]], requires_grad=True)
    params = static_params() | {"rgbs": rgbs}
    colors = activate_distractors(params).colors
    assert torch.equal(colors, torch.tensor([[0.0, 0.0, 0.25], [1.0, 1.0, 0.75]]))
    colors.sum().backward()
    assert rgbs.grad is not None
    assert torch.equal(rgbs.grad, torch.tensor([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]))


def test_resizing_keeps_the_parameter_that_the_optimizer_holds():
    params = nn.ParameterDict({"means": torch.zeros(2, 3)})
    held = params["means"]
    resize_rows(params, {"x.means": torch.ones(5, 3)}, "x.")
    assert params["means"] is held
    assert held.shape == (5, 3)


def test_sigmoid_of_infinities_is_exact_and_of_nan_nan():
    """Of what is finite: `tests/stability/test_stability_formulas.py`."""
    assert torch.equal(sigmoid(torch.tensor([math.inf, -math.inf])), torch.tensor([1.0, 0.0]))
    assert sigmoid(torch.tensor([math.nan])).isnan().all()
