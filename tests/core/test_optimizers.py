"""Optimizers: fused Adam, and rates that follow nominal steps in Python floats."""

import copy
import math
import sys
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import CosineDecaySchedulerConfig, ExponentialDecaySchedulerConfig
from torch import nn

from desplat_ns.core.optimizers import SHORT_RUN_GROUPS, FusedAdamConfig, follow, optimizer_options
from desplat_ns.core.schedule import Schedule, settling_factor
from desplat_ns.method_configs import desplat

RTOL = 16 * sys.float_info.epsilon
"""Logs, an exponential, a product and a quotient: a few roundings each."""


def stepped(make: Any) -> torch.Tensor:
    rng = torch.Generator().manual_seed(3)
    parameter = nn.Parameter(torch.randn(50, 3, generator=rng))
    optimizer = make([parameter])
    for _ in range(10):
        parameter.grad = torch.randn(50, 3, generator=rng)
        optimizer.step()
    return parameter.detach()


def test_fused_steps_are_those_of_plain_adam():
    ours = stepped(FusedAdamConfig(lr=0.05, eps=1e-9, weight_decay=0.1).setup)
    plain = stepped(lambda p: torch.optim.Adam(p, lr=0.05, eps=1e-9, weight_decay=0.1, fused=False))
    # Ten steps of at most lr, a few roundings each of numbers of order 1.
    assert torch.allclose(ours, plain, rtol=0, atol=10 * 8 * 2**-23)


def decay(**options: Any) -> ExponentialDecaySchedulerConfig:
    return ExponentialDecaySchedulerConfig(**{"lr_final": 1e-6, "max_steps": 100} | options)


def learning_rates(
    config: Any, lr: float, steps: int, scale: float | None = 1.0, settling: float = 0.0
) -> list[float]:
    """The rates that an optimizer gets over the first `steps` steps; by its own steps for None."""
    group = {"optimizer": AdamOptimizerConfig(lr=lr), "scheduler": config}
    parameters = {"means": [torch.nn.Parameter(torch.zeros(1))]}
    optimizers = Optimizers(optimizer_options({"means": group}), parameters)
    optimizer, rates = optimizers.optimizers["means"], []
    if scale is not None:
        at_the_end = partial(settling_factor, steps=100, share=settling)
        follow(optimizers, Schedule(scale), lambda step: 1.0, at_the_end)
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
    assert {type(rate) for rate in rates} == {float}


def test_in_the_last_share_of_a_run_rates_fall_evenly_towards_0():
    """Ten steps for 100 nominal ones, of a group without a schedule of its own too."""
    last = [0.1, 0.1, 0.1 * 2 / 3, 0.1 / 3]
    assert learning_rates(None, 0.1, 10, scale=0.1, settling=0.3)[-4:] == pytest.approx(last)


@pytest.mark.parametrize(
    "config",
    [
        decay(warmup_steps=7, lr_pre_warmup=1e-8),
        decay(lr_final=None),
        CosineDecaySchedulerConfig(warm_up_end=5, max_steps=100),
    ],
)
def test_a_short_run_samples_the_schedule_of_the_long_one(config):
    long, short = (learning_rates(config, 1e-3, *of) for of in ((41, None), (21, 0.5)))
    np.testing.assert_allclose(short, long[::2], rtol=RTOL)


def test_only_the_static_sets_rates_are_raised_and_the_originals_stay():
    before = copy.deepcopy(desplat.config.optimizers)
    raised = optimizer_options(desplat.config.optimizers, 3.0)
    assert desplat.config.optimizers == before
    assert set(raised) == set(before) >= set(SHORT_RUN_GROUPS)
    for name, group in raised.items():
        rate = before[name]["optimizer"].lr
        factor = 3.0 if name in SHORT_RUN_GROUPS else 1.0
        assert group["optimizer"].lr == pytest.approx(factor * rate)
        assert group["scheduler"] == before[name]["scheduler"]
    assert optimizer_options(before) == before
