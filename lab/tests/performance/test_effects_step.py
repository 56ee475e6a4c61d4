"""What is timed is a step of training with the effect, and the bare step is the one without."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.calibration.scenes import make_scene
from lab.performance.effects_step import CASES, OFF, step_of


@pytest.mark.parametrize("case", CASES)
def test_a_step_moves_gradients_into_everything_that_is_on(case):
    step = step_of(case, make_scene(200, 64, 48))
    if step.model.image_effects is not None:
        for parameter in step.model.image_effects.parameters():
            parameter.data += 0.01 * torch.randn_like(parameter)  # heads start at 0
    step()
    assert step.model.effects == (CASES[case] or OFF)
    for name, parameters in step.model.get_param_groups().items():
        if not name.startswith(("distractor", "camera_opt")):
            assert all(p.grad is not None and p.grad.abs().max() > 0 for p in parameters), name


def test_the_bare_step_is_that_of_a_model_with_everything_off():
    scene = make_scene(200, 64, 48)
    gradients = []
    for case in ("built without", "off"):
        step = step_of(case, scene)
        torch.manual_seed(1)  # of the background's colour
        step.photo = torch.full_like(step.photo, 0.3)
        step()
        gradients.append({n: p.grad for n, p in step.model.gauss_params.items()})
    for name, grad in gradients[0].items():
        assert torch.equal(grad, gradients[1][name]), name
