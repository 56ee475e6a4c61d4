from __future__ import annotations

import pytest
import torch

from desplat_ns.calibration.scenes import make_scene
from lab.gpu.plan import Job
from lab.gpu.scenes import NONE_PLACED, PLACED, PLAIN, SPLATFACTO, all_steps
from lab.gpu.stand_in import splatfacto_on


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    job = Job("cpu", True, str(tmp_path_factory.mktemp("work")))
    with splatfacto_on("cpu"):
        yield all_steps(job, make_scene(300, 64, 48))


def picture(step) -> torch.Tensor:
    step.model.eval()
    with torch.no_grad():
        image = step.model.get_outputs_for_camera(step.camera)["rgb"]
    step.model.train()
    return image


def test_splatfacto_and_desplat_draw_the_same_gaussians(steps):
    """Beyond rounding: of 300 Gaussians' colours each is off by a few eps of itself."""
    apart = (picture(steps[SPLATFACTO]) - picture(steps[PLAIN])).abs().max()
    assert picture(steps[PLAIN]).std() > 0.05 and apart < 300 * 8 * 1.2e-7


def test_cases_differ_in_their_distractors_alone(steps):
    counts = {
        name: None if step.model.distractors is None else step.model.distractors.counts()[0]
        for name, step in steps.items()
        if name != SPLATFACTO
    }
    assert counts == {PLAIN: None, NONE_PLACED: 0, PLACED: 20}


def test_a_step_moves_nothing_and_gives_every_gaussian_its_moments(steps):
    step = steps[SPLATFACTO]
    before = {name: value.detach().clone() for name, value in step.model.gauss_params.items()}
    step()
    for name, value in step.model.gauss_params.items():
        assert torch.equal(value, before[name])
        moments = step.optimizers.optimizers[name].state[value]["exp_avg"]
        assert moments.shape == value.shape and bool(moments.abs().sum() > 0)
