from __future__ import annotations

import pytest
import torch

from desplat_ns.backend.ssim import ssim
from desplat_ns.calibration.scenes import make_scene
from lab.performance.steps import plain_adam, plain_ssim
from lab.performance.training_step import PARTS, TrainingStep
from lab.performance.yardstick import YARDSTICK
from lab.pixels.contenders import backends

CONTENDERS = [YARDSTICK, *(c for c in backends()[0] if c.has_seams)]


@pytest.fixture(params=CONTENDERS, ids=lambda c: c.name)
def step(request) -> TrainingStep:
    chosen = plain_ssim if request.param.name == "yardstick" else ssim
    return TrainingStep(make_scene(300, 64, 48), request.param, chosen, plain_adam)


def gradients(step: TrainingStep) -> dict[str, torch.Tensor]:
    grads = {name: p.grad for name, p in step.params.items()}
    assert all(grad is not None for grad in grads.values())
    return {name: grad.clone() for name, grad in grads.items() if grad is not None}


def test_a_step_in_parts_computes_what_the_whole_one_does(step: TrainingStep):
    step.whole()
    whole, statistics = gradients(step), step.state["grad2d"].clone()
    step.state = step.strategy.initialize_state(scene_scale=1.0)
    step.in_parts()
    for name, grad in gradients(step).items():
        # the same float32 operations; sums of two branches may be taken in another order
        assert torch.allclose(grad, whole[name], rtol=1e-5, atol=1e-6 * float(grad.abs().max()))
        assert float(grad.abs().max()) > 0
    assert torch.allclose(step.state["grad2d"], statistics, rtol=1e-5)


def test_every_part_takes_time(step: TrainingStep):
    step.whole()
    clock = step.in_parts()
    assert set(clock.ms) == set(PARTS)
    assert all(ms > 0 for ms in clock.ms.values()), clock.ms


def test_steps_leave_the_parameters_where_they_are(step: TrainingStep):
    before = {name: p.detach().clone() for name, p in step.params.items()}
    step.whole()
    assert all(torch.equal(p, before[name]) for name, p in step.params.items())
