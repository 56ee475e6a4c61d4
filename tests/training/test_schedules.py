"""Schedules: scaled with the run, the same curves as nerfstudio's, in Python floats."""

from __future__ import annotations

import dataclasses
import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from nerfstudio.engine.optimizers import AdamOptimizerConfig
from nerfstudio.engine.schedulers import (
    CosineDecaySchedulerConfig,
    ExponentialDecaySchedulerConfig,
    MultiStepSchedulerConfig,
    SchedulerConfig,
)

from desplat_ns.errors import ConfigError
from desplat_ns.training.schedules import (
    ScaledExponentialDecaySchedulerConfig,
    scaled_optimizers,
    scaled_scheduler,
)

RTOL = 16 * sys.float_info.epsilon
"""Two powers, a product and a quotient against exp, two logs: a few roundings each."""


def learning_rates(config: Any, lr: float, steps: int) -> list[float]:
    """The rates that an optimizer gets over the first `steps` steps."""
    optimizer = torch.optim.Adam([torch.nn.Parameter(torch.zeros(1))], lr=lr)
    scheduler = config.setup().get_scheduler(optimizer, lr)
    rates = []
    for _ in range(steps):
        rates.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        scheduler.step()
    return rates


def test_decay_without_warm_up_takes_the_worked_out_values():
    config = ScaledExponentialDecaySchedulerConfig(lr_final=1e-4, max_steps=100)
    assert config.lr_at(0, 1e-2) == 1e-2
    assert config.lr_at(50, 1e-2) == pytest.approx(1e-3, rel=RTOL)  # geometric mean
    assert config.lr_at(100, 1e-2) == pytest.approx(1e-4, rel=RTOL)
    assert config.lr_at(1000, 1e-2) == config.lr_at(100, 1e-2)


def test_the_warm_up_takes_the_worked_out_values():
    config = ScaledExponentialDecaySchedulerConfig(
        lr_pre_warmup=0.0, lr_final=0.1, warmup_steps=10, max_steps=20
    )
    assert config.lr_at(0, 1.0) == 0.0
    assert config.lr_at(5, 1.0) == pytest.approx(math.sqrt(0.5), rel=RTOL)  # sin(45 degrees)
    assert config.lr_at(10, 1.0) == 1.0
    linear = dataclasses.replace(config, ramp="linear")
    assert linear.lr_at(5, 1.0) == 0.5


@pytest.mark.parametrize("ramp", ["cosine", "linear"])
@pytest.mark.parametrize(("lr_final", "warmup"), [(1.6e-6, 0), (5e-7, 7), (None, 3)])
def test_the_rates_are_those_of_nerfstudio(ramp, lr_final, warmup):
    options: dict[str, Any] = dict(
        lr_final=lr_final, warmup_steps=warmup, max_steps=30, ramp=ramp, lr_pre_warmup=1e-8
    )
    theirs = learning_rates(ExponentialDecaySchedulerConfig(**options), 1.6e-4, 40)
    ours = learning_rates(ScaledExponentialDecaySchedulerConfig(**options), 1.6e-4, 40)
    np.testing.assert_allclose(ours, theirs, rtol=RTOL)


def test_every_rate_is_a_python_float():
    config = ScaledExponentialDecaySchedulerConfig(lr_final=1e-6, warmup_steps=2, max_steps=4)
    assert {type(rate) for rate in learning_rates(config, 1e-3, 8)} == {float}


def test_a_scaled_schedule_is_the_long_one_sampled():
    long = ScaledExponentialDecaySchedulerConfig(lr_final=1e-6, warmup_steps=100, max_steps=1000)
    short = long.scaled(0.1)
    for step in range(0, 120):
        assert short.lr_at(step, 1e-3) == pytest.approx(long.lr_at(10 * step, 1e-3), rel=RTOL)
    assert long.max_steps == 1000


@given(scale=st.floats(1e-6, 1.0), step=st.integers(0, 2000), warmup=st.integers(0, 2000))
def test_rates_stay_between_the_ends_at_every_scale(scale, step, warmup):
    config = ScaledExponentialDecaySchedulerConfig(
        lr_final=1e-6, warmup_steps=warmup, max_steps=1000
    )
    assert 1e-8 * (1 - RTOL) <= config.scaled(scale).lr_at(step, 1e-3) <= 1e-3 * (1 + RTOL)


def test_a_rate_of_zero_freezes_its_group():
    config = ScaledExponentialDecaySchedulerConfig(lr_final=1e-6, max_steps=10)
    assert learning_rates(config, 0.0, 5) == [0.0] * 5


def test_a_decay_to_zero_is_refused_with_the_option_to_set():
    config = ScaledExponentialDecaySchedulerConfig(lr_final=0.0, max_steps=10)
    with pytest.raises(ConfigError, match="lr-final"):
        learning_rates(config, 1e-3, 1)


def test_nerfstudios_exponential_decay_becomes_ours():
    config = ExponentialDecaySchedulerConfig(lr_final=1e-6, warmup_steps=100, max_steps=3000)
    assert scaled_scheduler(config, 0.1) == ScaledExponentialDecaySchedulerConfig(
        lr_final=1e-6, warmup_steps=10, max_steps=300
    )


def test_the_other_schedulers_of_nerfstudio_are_scaled_too():
    steps = scaled_scheduler(MultiStepSchedulerConfig(max_steps=1000, milestones=(100, 500)), 0.1)
    assert isinstance(steps, MultiStepSchedulerConfig)
    assert (steps.max_steps, steps.milestones) == (100, (10, 50))
    cosine = scaled_scheduler(CosineDecaySchedulerConfig(warm_up_end=50, max_steps=1000), 0.1)
    assert isinstance(cosine, CosineDecaySchedulerConfig)
    assert (cosine.warm_up_end, cosine.max_steps) == (5, 100)


@dataclass
class UnknownSchedulerConfig(SchedulerConfig):
    """A scheduler that the package has never heard of."""

    max_steps: int = 100


def test_an_unknown_scheduler_keeps_its_steps_and_that_is_said(capsys):
    config = UnknownSchedulerConfig()
    assert scaled_scheduler(config, 0.5) is config
    assert "UnknownSchedulerConfig" in capsys.readouterr().out


def test_scaling_optimizers_leaves_the_configuration_it_was_given_alone():
    decay = ExponentialDecaySchedulerConfig(lr_final=1e-6, max_steps=1000)
    adam = AdamOptimizerConfig(lr=1e-3)
    optimizers = {
        "means": {"optimizer": adam, "scheduler": decay},
        "quats": {"optimizer": adam, "scheduler": None},
    }
    scaled = scaled_optimizers(optimizers, 0.1)
    assert scaled["means"]["scheduler"].max_steps == 100
    assert scaled["means"]["optimizer"] is adam
    assert scaled["quats"]["scheduler"] is None
    assert optimizers["means"]["scheduler"] is decay
    assert decay.max_steps == 1000
