"""The step that is timed is a step, in every light; its parts are what they are called."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.calibration.scenes import make_scene
from desplat_ns.photo_tourism.config import has_bfloat16
from lab.performance.appearance_step import CASES, LitStep, parts


@pytest.mark.parametrize("case", CASES)
def test_a_step_moves_gradients_into_everything(case):
    if "bfloat16" in case and not has_bfloat16("cpu"):
        pytest.skip("this processor has no instructions for bfloat16")
    step = LitStep(make_scene(200, 64, 48), *CASES[case])
    step.whole()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in step.params.values())
    if step.effects is not None:
        times = parts(step)
        assert 0 < times["rows in view"] <= 200 and times["network, forward"] > 0
        for parameter in step.effects.parameters():
            assert parameter.grad is not None and parameter.grad.isfinite().all()
            assert torch.count_nonzero(parameter.grad) > 0
