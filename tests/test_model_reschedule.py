"""A run that is lengthened or shortened on the way moves what is ahead of it, in both sets."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.relocation import RelocatingStrategy
from desplat_ns.gaussians.strategy import StaticStrategy
from desplat_ns.training.budget import Stretch
from tests.helpers.small_model import Trainer, make_model


def test_thresholds_that_are_ahead_move_and_those_behind_stay():
    settings = DistractorConfig(
        per_view=20,
        max_warmup_visits=1000,
        static_warmup=100,
        stop_densify_at=500,
        stop_placing_at=900,
    )
    model = make_model(stop_screen_size_at=200, stop_split_at=600, distractors=settings)
    model.reschedule(Stretch(300, 2.0))
    assert (model.config.stop_screen_size_at, model.config.stop_split_at) == (200, 900)
    assert isinstance(model.strategy, StaticStrategy)
    assert model.strategy.refine_stop_iter == 900
    assert model.strategy.refine_scale2d_stop_iter == 200
    assert model.layer is not None
    moved = model.layer.config
    assert moved.static_warmup == 100
    assert (moved.stop_densify_at, moved.stop_placing_at) == (700, 1500)
    assert settings.stop_densify_at == 500  # the method's own settings stay


def test_distractors_are_densified_until_the_step_that_was_moved():
    model = make_model(distractors=DistractorConfig(per_view=20, stop_densify_at=10))
    assert model.layer is not None
    model.reschedule(Stretch(5, 3.0))
    assert model.layer.densifier.config.stop_densify_at == 20


def test_a_set_that_is_controlled_by_relocation_trains_and_grows():
    model = make_model(
        density_control="relocation",
        warmup_length=0,
        stop_split_at=20,
        distractors=DistractorConfig(per_view=20),
        gaussians_per_pixel=1.0,
    )
    assert isinstance(model.strategy, RelocatingStrategy)
    model.config.relocation.times = 5
    trainer, before = Trainer(model), model.num_points
    for step in range(1, 25):
        assert trainer.step(step, step % 3)["losses"]["relocation"] > 0
    assert model.num_points > before
    assert torch.isfinite(model.means).all()
    grown = model.num_points
    model.reschedule(Stretch(24, 2.0))
    trainer.step(25)
    assert model.num_points == grown


def test_nothing_is_charged_for_relocation_where_gradients_control_the_density():
    model = make_model(distractors=DistractorConfig(per_view=20))
    assert isinstance(model.strategy, StaticStrategy)
    assert "relocation" not in Trainer(model).step(1)["losses"]


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
