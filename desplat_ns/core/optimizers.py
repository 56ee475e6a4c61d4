"""The optimizers of a run: nerfstudio's, with rates that follow the run's schedule."""

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from desplat_ns.core.schedule import RunStep, Schedule

SHORT_RUN_GROUPS = ("means", "scales", "quats", "features_dc", "features_rest")
"""Groups whose rates are raised in short runs: the static set's. The rate of its opacities suits
short runs already, and distractors are trained by visits of their own."""

STATIC_GROUPS = (*SHORT_RUN_GROUPS, "opacities")
"""Groups whose rates fall to 0 at the end."""


def adam(
    params: list[Any], lr: float = 0.0, eps: float = 1e-15, weight_decay: float | int = 0
) -> Optimizer:
    """torch's Adam of parameters, or of groups with rates of their own, with Splatfacto's epsilon,
    in one pass: a third of the time on a CPU."""
    return torch.optim.Adam(params, lr=lr, eps=eps, weight_decay=weight_decay, fused=True)


@dataclass
class FusedAdamConfig(AdamOptimizerConfig):
    """nerfstudio's Adam, fused (`adam`)."""

    def setup(self, params: list[nn.Parameter]) -> Optimizer:
        return adam(params, self.lr, self.eps, self.weight_decay)


def optimizer_options(optimizers: Mapping[str, Any], factor: float = 1.0) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers`, with a factor on the rates of `SHORT_RUN_GROUPS`; a
    rate that decays still ends at `lr_final`. One of 0 is frozen: it has no exponential decay."""
    copied = dict(optimizers)
    for name, group in optimizers.items():
        optimizer, decay = group["optimizer"], group["scheduler"]
        if isinstance(decay, ExponentialDecaySchedulerConfig) and optimizer.lr == 0:
            decay = None
        if name in SHORT_RUN_GROUPS and factor != 1.0:
            optimizer = copy(optimizer)
            optimizer.lr *= factor
        copied[name] = {**group, "optimizer": optimizer, "scheduler": decay}
    return copied


def follow(
    optimizers: Optimizers,
    schedule: Schedule,
    early: Callable[[int], float],
    settling: Callable[[int], float],
) -> None:
    """Let all rates go by the nominal steps of a schedule from now on, at which those of
    `SHORT_RUN_GROUPS` have the factor `early`, and those of `STATIC_GROUPS` also `settling`. They
    are Python floats: numpy's, which nerfstudio 1.1.5 returns, end up in the checkpoint, and torch
    >= 2.6 refuses to load it."""

    def read_at(curve: Any, factors: list[Callable[[int], float]]) -> Callable[[int], float]:
        def rate(step: int) -> float:
            nominal = schedule.nominal(RunStep(step))
            return math.prod([float(curve(nominal)), *(factor(nominal) for factor in factors)])

        return rate

    schedulers = optimizers.schedulers
    for name in set(STATIC_GROUPS) & optimizers.optimizers.keys() - schedulers.keys():
        schedulers[name] = LambdaLR(optimizers.optimizers[name], lambda step: 1.0)
    for name, scheduler in schedulers.items():
        factors = [early] * (name in SHORT_RUN_GROUPS) + [settling] * (name in STATIC_GROUPS)
        scheduler.lr_lambdas = [read_at(curve, factors) for curve in scheduler.lr_lambdas]
        set_position(scheduler, scheduler.last_epoch)


def set_position(scheduler: LambdaLR, steps_done: int) -> None:
    """Put a scheduler, and the rates of its optimizer, where they are after a number of steps."""
    scheduler.last_epoch, scheduler._step_count = steps_done, steps_done + 1
    rates = [
        base * curve(steps_done)
        for base, curve in zip(scheduler.base_lrs, scheduler.lr_lambdas, strict=True)
    ]
    for group, rate in zip(scheduler.optimizer.param_groups, rates, strict=True):
        group["lr"] = rate
    scheduler._last_lr = rates


def load_moments(optimizers: Optimizers, saved: Mapping[str, Any]) -> None:
    """Bring back the optimizers' moments from a checkpoint, once the parameters have their saved
    shapes; rates, epsilons and the like stay those of this run's options."""
    for name, optimizer in optimizers.optimizers.items():
        own = [{k: v for k, v in g.items() if k != "params"} for g in optimizer.param_groups]
        optimizer.load_state_dict(saved[name])
        for group, options in zip(optimizer.param_groups, own, strict=True):
            group.update(options)
