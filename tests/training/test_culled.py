"""Gaussians that no view shows are counted, and must not be most of a scene that is saved."""

from __future__ import annotations

import math
from math import nan as NAN

import pytest

from desplat_ns.errors import TrainingError
from desplat_ns.training.culled import TOO_WIDE, culled_always
from desplat_ns.training.step_guard import (
    check_parameters,
)
from tests.helpers.guarded_trainer import GuardedTrainer, everywhere
from tests.helpers.stub_run import config as config  # a fixture


@pytest.mark.parametrize(
    ("name", "value"),
    [("means", NAN), ("means", 1e30), ("scales", 1e30), ("quats", 0.0), ("features_dc", 1e25)],
)
def test_gaussians_that_no_view_shows_are_counted(name, value):
    model = everywhere()
    model.gauss_params[name].data[:2] = value
    assert model.culled_static() == 2


def test_a_learning_rate_spike_is_not_saved(tmp_path):
    trainer = GuardedTrainer(everywhere())
    trainer.optimizers.optimizers["means"].param_groups[0]["lr"] = 1e30
    for step in range(3):
        trainer.step(step)
    with pytest.raises(TrainingError, match=r"static Gaussians hold values that no view can show"):
        check_parameters(trainer.model, trainer.optimizers, 3, tmp_path, strict=False)


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
