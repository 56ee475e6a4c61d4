"""Gaussians that no view shows are counted, told once, and must not be most of the scene."""

from __future__ import annotations

import math
from math import nan as NAN

import pytest

from desplat_ns.errors import TrainingError
from desplat_ns.training.culled import TOO_WIDE, culled_always
from desplat_ns.training.step_guard import (
    check_parameters,
)
from tests.helpers.guarded_trainer import GuardedTrainer, everywhere, said
from tests.helpers.small_model import camera
from tests.helpers.stub_run import config as config  # a fixture


@pytest.mark.parametrize(
    ("name", "value"),
    [("means", NAN), ("means", 1e30), ("scales", 1e30), ("quats", 0.0), ("features_dc", 1e25)],
)
def test_gaussians_that_no_view_shows_are_counted_logged_and_told_once(name, value, capsys):
    model = everywhere()
    trainer = GuardedTrainer(model)
    trainer.step(1)
    model.gauss_params[name].data[:2] = value
    assert model.culled_static() == 2
    model._count_culled(100)
    model._count_culled(200)
    outputs = model(camera(0))
    metrics = model.get_metrics_dict(outputs, {"image": trainer.photo})
    assert metrics["culled_static"] == 2
    assert metrics["culled_distractors"] == 0
    assert said(capsys).count("2 static Gaussians and 0 distractors") == 1


def test_a_distractor_that_is_culled_is_counted():
    model = everywhere()
    assert model.distractors is not None
    model.distractors.views[1].params["means"].data[3] = NAN
    assert (model.culled_static(), model.culled_distractors()) == (0, 1)


def test_a_learning_rate_spike_ends_the_run_with_its_reason():
    trainer = GuardedTrainer(everywhere())
    model = trainer.model
    trainer.optimizers.optimizers["means"].param_groups[0]["lr"] = 1e30
    with pytest.raises(TrainingError, match=r"static Gaussians hold values that no view can show"):
        for step in range(model.culled.interval + 1):
            trainer.step(step)


def test_a_scale_that_is_large_but_drawn_is_not_counted():
    model = everywhere()
    model.gauss_params["scales"].data[:] = 15.0
    assert model.culled_static() == 0
    assert math.isfinite(TOO_WIDE)


def test_some_culled_gaussians_may_be_saved_but_not_most(tmp_path):
    trainer = GuardedTrainer(everywhere())
    model, means = trainer.model, trainer.model.gauss_params["means"].data
    means[:3] = NAN
    check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)
    with pytest.raises(TrainingError, match="means are not finite"):
        check_parameters(model, trainer.optimizers, 5, tmp_path, strict=True)
    means[: len(means) // 2 + 1] = NAN
    with pytest.raises(TrainingError, match=r"16 of 30 static Gaussians.*start anew"):
        check_parameters(model, trainer.optimizers, 5, tmp_path, strict=False)


def test_nothing_is_culled_always_in_a_healthy_scene():
    from desplat_ns.gaussians.activation import activate_static

    assert not culled_always(activate_static(everywhere().gauss_params, 0)).any()
