"""The optimizers of a run: nerfstudio's, with rates that follow the run's schedule."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR

from desplat_ns.errors import CheckpointError, ConfigError
from desplat_ns.training.schedule import Schedule

SHORT_RUN_GROUPS = ("means", "scales", "quats", "features_dc", "features_rest")
"""Groups whose rates are raised in short runs: the static set's. The rate of its opacities suits
short runs already, and distractors are trained by visits of their own."""


def adam(params: list[nn.Parameter], lr: float, **options: Any) -> Optimizer:
    """torch's Adam with Splatfacto's epsilon of 1e-15, as gradients of Gaussians are small.

    It updates moments and parameters in one pass, a third of the time on a CPU; in several, to the
    same values up to rounding, where torch has no fused one for the parameters' device.

    Args:
        options: others of `torch.optim.Adam`.
    """
    options = {"eps": 1e-15} | options
    try:
        return torch.optim.Adam(params, lr=lr, fused=True, **options)
    except RuntimeError as error:
        if "fused" not in str(error):  # torch names the option that it refuses
            raise
    return torch.optim.Adam(params, lr=lr, **options)


@dataclass
class FusedAdamConfig(AdamOptimizerConfig):
    """nerfstudio's Adam, fused where torch can (`adam`)."""

    def setup(self, params: list[nn.Parameter]) -> Optimizer:
        """The optimizer of one group of parameters."""
        return adam(params, self.lr, eps=self.eps, weight_decay=self.weight_decay)


def optimizer_options(optimizers: Mapping[str, Any], factor: float = 1.0) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers`, checked; a group whose rate is 0 is frozen, and has
    no schedule.

    Args:
        factor: on the rates of `SHORT_RUN_GROUPS`; a rate that decays still ends at `lr_final`.

    Raises:
        ConfigError: a rate of an exponential decay is not positive, or its warm-up does not end
            before the decay.
    """
    checked = dict(optimizers)
    for name, group in optimizers.items():
        optimizer, decay = group["optimizer"], group["scheduler"]
        if isinstance(decay, ExponentialDecaySchedulerConfig):
            option, lr = f"--optimizers.{name}.scheduler", optimizer.lr
            if lr < 0 or (decay.lr_final is not None and decay.lr_final <= 0):
                raise ConfigError(
                    f"An exponential decay runs between positive learning rates; found lr {lr} and "
                    f"lr-final {decay.lr_final}. Give a positive {option}.lr-final, or lr 0 to "
                    "freeze the group."
                )
            if decay.warmup_steps >= decay.max_steps:
                raise ConfigError(
                    f"{option}.warmup-steps is {decay.warmup_steps}; it has to be below max-steps, "
                    f"{decay.max_steps}."
                )
            decay = decay if lr != 0 else None
        if name in SHORT_RUN_GROUPS and factor != 1.0:
            optimizer = copy(optimizer)
            optimizer.lr *= factor
        checked[name] = {**group, "optimizer": optimizer, "scheduler": decay}
    return checked


def follow(
    optimizers: Optimizers, schedule: Schedule, early: Callable[[int], float] | None = None
) -> None:
    """Let all rates go by the nominal steps of a schedule from now on.

    Rates are Python floats then: numpy scalars, which nerfstudio 1.1.5 returns, end up in the
    checkpoint, and torch >= 2.6 refuses to load it.

    Args:
        early: factor on the rates of `SHORT_RUN_GROUPS` at a step of the run.
    """

    def read_at(curve: Callable[[int], float], factor: Any) -> Callable[[int], float]:
        factor = factor or (lambda step: 1.0)
        return lambda step: float(curve(schedule.nominal(step))) * factor(step)

    for name, optimizer in optimizers.optimizers.items():
        factor = early if name in SHORT_RUN_GROUPS else None
        if factor is not None and name not in optimizers.schedulers:
            optimizers.schedulers[name] = LambdaLR(optimizer, lambda step: 1.0)
        scheduler = optimizers.schedulers.get(name)
        if scheduler is not None:
            assert isinstance(scheduler, LambdaLR), "as all that nerfstudio's methods have"
            curves: list[Any] = list(scheduler.lr_lambdas)
            scheduler.lr_lambdas = [read_at(curve, factor) for curve in curves]
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


def load_moments(optimizers: Optimizers, saved: Mapping[str, Any], source: Path) -> None:
    """Bring back the optimizers' moments from the checkpoint `source`.

    Rates, epsilons and the like stay those of this run's options. The parameters must have their
    saved shapes already: the pipeline is loaded first. Raises CheckpointError, before anything is
    changed, where groups do not match.
    """
    here, there = set(optimizers.optimizers), set(saved)
    if here != there:
        raise CheckpointError(
            f"The checkpoint {source} was trained with other effects: it alone has "
            f"{', '.join(sorted(there - here)) or 'nothing'}, this run alone "
            f"{', '.join(sorted(here - there)) or 'nothing'}. Switch on the same "
            "--pipeline.model.effects as in that run's config.yml."
        )
    for name, optimizer in optimizers.optimizers.items():
        own = [{k: v for k, v in g.items() if k != "params"} for g in optimizer.param_groups]
        optimizer.load_state_dict(saved[name])
        for group, options in zip(optimizer.param_groups, own, strict=True):
            group.update(options)
