"""Schedules: nerfstudio's curves, read at the nominal steps of a clock, in Python floats."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest
import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import (
    CosineDecaySchedulerConfig,
    ExponentialDecaySchedulerConfig,
    MultiStepSchedulerConfig,
)

from desplat_ns.errors import ConfigError
from desplat_ns.training.budget import Clock
from desplat_ns.training.schedules import checked_schedules, follow

RTOL = 16 * sys.float_info.epsilon
"""Logs, an exponential, a product and a quotient: a few roundings each."""


def decay(**options: Any) -> ExponentialDecaySchedulerConfig:
    return ExponentialDecaySchedulerConfig(**{"lr_final": 1e-6, "max_steps": 100} | options)


def learning_rates(config: Any, lr: float, steps: int, scale: float | None = 1.0) -> list[float]:
    """The rates that an optimizer gets over the first `steps` steps; by its own steps for None."""
    group = {"optimizer": AdamOptimizerConfig(lr=lr), "scheduler": config}
    parameters = {"means": [torch.nn.Parameter(torch.zeros(1))]}
    optimizers = Optimizers(checked_schedules({"means": group}), parameters)
    optimizer, rates = optimizers.optimizers["means"], []
    for scheduler in optimizers.schedulers.values():
        if scale is not None:
            follow(scheduler, Clock(scale))
    for _ in range(steps):
        rates.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        for scheduler in optimizers.schedulers.values():
            scheduler.step()
    return rates


def test_a_decay_takes_the_worked_out_values_at_nominal_steps():
    """A tenth of the method's steps; the warm-up ends at nominal step 20."""
    config = decay(lr_pre_warmup=0.0, lr_final=1e-3, warmup_steps=20, max_steps=60)
    rates = learning_rates(config, 1e-1, 8, scale=0.1)
    first = [0.0, 0.1 * math.sqrt(0.5)]  # sin(45 degrees)
    assert rates == pytest.approx([*first, 1e-1, 10**-1.5, 1e-2, 10**-2.5, 1e-3, 1e-3], rel=RTOL)


@pytest.mark.parametrize(
    "config",
    [
        decay(warmup_steps=7, lr_pre_warmup=1e-8),
        decay(ramp="linear", warmup_steps=3),
        decay(lr_final=None),
        CosineDecaySchedulerConfig(warm_up_end=5, max_steps=100),
    ],
)
def test_a_short_run_samples_the_schedule_of_the_long_one(config):
    long, short = (learning_rates(config, 1e-3, *of) for of in ((41, None), (21, 0.5)))
    np.testing.assert_allclose(short, long[::2], rtol=RTOL)


def test_every_rate_is_a_python_float():
    assert {type(rate) for rate in learning_rates(decay(warmup_steps=2), 1e-3, 8)} == {float}


def test_a_rate_of_zero_freezes_its_group():
    assert learning_rates(decay(), 0.0, 5) == [0.0] * 5


@pytest.mark.parametrize(
    ("lr", "options", "named"),
    [
        (1e-3, {"lr_final": 0.0}, "means.scheduler.lr-final"),
        (-1e-3, {}, "positive learning rates"),
        (1e-3, {"warmup_steps": 100}, "means.scheduler.warmup-steps is 100"),
    ],
)
def test_a_decay_that_cannot_be_followed_is_refused_with_the_option_to_set(lr, options, named):
    with pytest.raises(ConfigError, match=named):
        learning_rates(decay(**options), lr, 1)


def test_a_scheduler_that_is_no_function_of_the_step_keeps_the_runs_steps_and_that_is_said(capsys):
    config = MultiStepSchedulerConfig(milestones=(2, 4), gamma=0.5)
    assert learning_rates(config, 1.0, 5, scale=0.5) == [1.0, 1.0, 0.5, 0.5, 0.25]
    assert "MultiStepLR goes by the steps of the run" in capsys.readouterr().out


def test_checking_leaves_the_configuration_it_was_given_alone():
    optimizers = {"means": {"optimizer": AdamOptimizerConfig(lr=0.0), "scheduler": decay()}}
    assert checked_schedules(optimizers)["means"]["scheduler"] is None
    assert optimizers["means"]["scheduler"] == decay()
