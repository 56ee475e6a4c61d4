"""Schedules of both sets are read at the clock of the run; what density control charges."""

import pytest
import torch
from nerfstudio.engine.optimizers import Optimizers

from desplat_ns.core.schedule import NominalStep, RunStep, Schedule
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.losses import RESPONSE_OBSERVATIONS
from desplat_ns.photo_tourism.camera_response import PRIOR_STD
from tests.helpers.small_model import Trainer, camera, make_model, model_with


class At(Schedule):
    """A clock that somebody sets."""

    now = 0.0

    def nominal(self, step: RunStep) -> NominalStep:
        return NominalStep(round(self.now / self.scale))


def test_thresholds_of_both_sets_are_read_at_the_clock():
    settings = DistractorConfig(per_view=20, static_warmup=100)
    model = make_model(sh_degree_interval=50, distractors=settings)
    model.schedule = clock = At(0.5)
    optimizers = Optimizers({}, {})
    for clock.now in (49.7, 50.1):
        model.step_cb(optimizers, 7)
        assert model.step == 7
        model.train()
        model(camera(0))
        assert model.train_step.nominal == round(2 * clock.now)
        assert (model.train_step.distractors is not None) == (clock.now > 50)
        assert model.active_sh_degree == (2 if clock.now > 50 else 1)


def test_a_reset_that_time_passes_over_is_made_and_none_is_made_twice():
    """Steps at which a clock may stand: it goes by seconds."""
    model = make_model(reset_alpha_every=1, warmup_length=10**6)
    model.schedule = clock = At()
    trainer, reset = Trainer(model), []
    for clock.now in (10, 40, 80, 130, 130, 170, 210, 290, 300, 300, 310):
        with torch.no_grad():
            model.gauss_params["opacities"].fill_(3.0)
        trainer.step(700)
        if model.gauss_params["opacities"].sigmoid().max() < 0.9:
            reset.append(clock.now)
    assert reset == [130, 210, 300]


def test_an_opacity_prior_is_the_mean_of_what_the_view_shows_over_the_number_of_photos():
    model = make_model(opacity_prior=0.6, distractors=DistractorConfig(per_view=20))
    with torch.no_grad():
        model.means[: model.num_points // 2] += 1e4  # beyond every view
    opacities = model.gauss_params["opacities"].detach().sigmoid()
    trained = Trainer(model).step(1)
    charged, shown = trained["losses"]["opacity_prior"], trained["step"].static.visible
    assert 0 < int(shown.sum()) < model.num_points
    expected = 0.6 / model.num_train_data * float(opacities[shown].mean())
    assert float(charged.detach()) == pytest.approx(expected)


def test_a_cameras_response_is_charged_by_its_prior_in_units_of_the_loss():
    model = model_with("camera", opacity_prior=0.6)
    assert model.config.opacity_prior == 0.6
    assert model_with("affine", opacity_prior=0.6).config.opacity_prior == 0
    with torch.no_grad():
        model.image_effects.responses[:] = 0.3  # what all photos have in common costs nothing
        model.image_effects.responses[0] += 2 * torch.tensor(PRIOR_STD)
    losses = {name: float(loss.detach()) for name, loss in Trainer(model).step(1)["losses"].items()}
    others = 1 - 1 / model.num_train_data  # its own share of the mean
    expected = 5 * (2 * others) ** 2 / (2 * RESPONSE_OBSERVATIONS) * losses["main_loss"]
    assert losses["camera_response"] == pytest.approx(expected)
