"""Schedules of both sets are read at the clock of the run; what density control charges."""

from __future__ import annotations

import pytest
import torch
from nerfstudio.engine.optimizers import Optimizers

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.strategy import StaticStrategy
from desplat_ns.training.budget import Clock
from tests.helpers.small_model import Trainer, camera, make_model


class At(Clock):
    """A clock that somebody sets."""

    now = 0.0

    def at(self, step: int) -> int | float:
        return self.now


def test_thresholds_of_both_sets_are_read_at_the_clock():
    settings = DistractorConfig(per_view=20, max_warmup_visits=1000, static_warmup=100)
    model = make_model(sh_degree_interval=50, distractors=settings)
    clock = At()
    model.follow(clock)
    assert model.layer is not None
    optimizers = Optimizers({}, {})
    for now in (99.4, 100.2):
        clock.now = now
        model.step_cb(optimizers, 7)
        assert model.step == round(now)
        model.train()
        model(camera(0))
        assert model.train_step is not None and model.train_step.number == model.step
        assert (model.train_step.distractors is not None) == (now > 100)


def test_distractors_are_densified_until_the_clock_says_so():
    model = make_model(
        warmup_length=0, distractors=DistractorConfig(per_view=20, stop_densify_at=10)
    )
    assert model.layer is not None
    clock, trainer = At(), Trainer(model)
    model.follow(clock)
    sampled = []
    for clock.now in (5.0, 9.4, 9.6):
        before = model.layer.gaussians.views[0].state.get("count")
        before = None if before is None else before.clone()
        model.step_cb(Optimizers({}, {}), 700)
        trainer.step(model.step, 0)
        after = model.layer.gaussians.views[0].state.get("count")
        sampled.append(after is not None and (before is None or not torch.equal(before, after)))
    assert sampled == [True, True, False]


def test_a_reset_that_time_passes_over_is_made_and_none_is_made_twice():
    """Steps at which a clock may stand: it goes by seconds."""
    model = make_model(reset_alpha_every=1, schedule_scale=0.1, warmup_length=10**6)
    assert isinstance(model.strategy, StaticStrategy)
    assert model.strategy.reset_every == 10
    trainer, reset = Trainer(model), []
    for now in (1, 4, 8, 13, 13, 17, 21, 29, 30, 30, 31):
        with torch.no_grad():
            model.gauss_params["opacities"].fill_(3.0)
        trainer.step(now)
        if model.gauss_params["opacities"].sigmoid().max() < 0.9:
            reset.append(now)
    assert reset == [13, 21, 30]


def test_an_opacity_prior_is_the_mean_of_what_the_view_shows_over_the_number_of_photos():
    model = make_model(opacity_prior=0.6, distractors=DistractorConfig(per_view=20))
    with torch.no_grad():
        model.means[: model.num_points // 2] += 1e4  # beyond every view
    opacities = model.gauss_params["opacities"].detach().sigmoid()
    charged = Trainer(model).step(1)["losses"]["opacity_prior"]
    assert 0 < int(model.shown.sum()) < model.num_points
    expected = 0.6 / model.num_train_data * float(opacities[model.shown].mean())
    assert float(charged.detach()) == pytest.approx(expected)


def test_without_an_opacity_prior_nothing_is_charged():
    model = make_model(distractors=DistractorConfig(per_view=20))
    assert "opacity_prior" not in Trainer(model).step(1)["losses"]
