"""Schedules that shrink with the length of a run: 1,000 steps are a small version of 30,000.

A method states its schedules for its own number of steps. A shorter run multiplies every warm-up,
interval and decay by one number, the schedule scale; a longer run keeps them as they are.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from nerfstudio.engine.schedulers import (
    CosineDecaySchedulerConfig,
    ExponentialDecaySchedulerConfig,
    MultiStepSchedulerConfig,
    Scheduler,
    SchedulerConfig,
)
from nerfstudio.utils.rich_utils import CONSOLE
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

from desplat_ns.errors import ConfigError
from desplat_ns.training.run_length import scaled_steps


@dataclass
class ScaledExponentialDecaySchedulerConfig(ExponentialDecaySchedulerConfig):
    """Exponential decay after a warm-up, in steps of the method's own length."""

    _target: type = field(default_factory=lambda: ScaledExponentialDecayScheduler)

    def scaled(self, scale: float) -> ScaledExponentialDecaySchedulerConfig:
        """A copy whose warm-up and decay take `scale` times as many steps."""
        return dataclasses.replace(
            self,
            warmup_steps=scaled_steps(self.warmup_steps, scale),
            max_steps=scaled_steps(self.max_steps, scale),
        )

    def lr_at(self, step: int | float, lr_init: float) -> float:
        """Learning rate at `step`: a ramp from `lr_pre_warmup` up to `lr_init`, then log-linear
        down to `lr_final`, reached at `max_steps` and kept.

        A Python float: numpy scalars, which nerfstudio 1.1.5 returns, end up in the checkpoint
        and torch >= 2.6 then refuses to load it.
        """
        if step < self.warmup_steps:
            t = step / self.warmup_steps
            ramp = math.sin(0.5 * math.pi * t) if self.ramp == "cosine" else t
            return self.lr_pre_warmup + (lr_init - self.lr_pre_warmup) * ramp
        lr_final = lr_init if self.lr_final is None else self.lr_final
        span = self.max_steps - self.warmup_steps
        t = min((step - self.warmup_steps) / span, 1.0) if span > 0 else 1.0
        return lr_init ** (1.0 - t) * lr_final**t


class ScaledExponentialDecayScheduler(Scheduler):
    """Builds torch's scheduler from a ScaledExponentialDecaySchedulerConfig."""

    config: ScaledExponentialDecaySchedulerConfig

    def get_scheduler(self, optimizer: Optimizer, lr_init: float) -> LRScheduler:
        """A LambdaLR that follows `lr_at`. Raises ConfigError where a rate is not positive.

        `lr_init` 0 freezes the group: its rate stays 0 throughout.
        """
        lr_final = self.config.lr_final
        if lr_init < 0 or (lr_final is not None and lr_final <= 0):
            raise ConfigError(
                f"An exponential decay runs between positive learning rates; found lr {lr_init} "
                f"and lr-final {lr_final}. Give a positive --optimizers.GROUP.scheduler.lr-final, "
                "or lr 0 to freeze the group."
            )
        if lr_init == 0:
            return LambdaLR(optimizer, lr_lambda=lambda step: 1.0)
        config = self.config
        return LambdaLR(optimizer, lr_lambda=lambda step: config.lr_at(step, lr_init) / lr_init)


def scaled_scheduler(config: SchedulerConfig | None, scale: float) -> SchedulerConfig | None:
    """`config` with all its steps multiplied by `scale`; None (a constant rate) stays None.

    nerfstudio's own exponential decay becomes ours (same curve, Python floats).
    A scheduler of an unknown kind keeps its steps, which is said on the console.
    """
    if isinstance(config, ScaledExponentialDecaySchedulerConfig):
        return config.scaled(scale)
    if isinstance(config, ExponentialDecaySchedulerConfig):
        options = {f.name: getattr(config, f.name) for f in dataclasses.fields(config)}
        del options["_target"]
        return ScaledExponentialDecaySchedulerConfig(**options).scaled(scale)
    if isinstance(config, MultiStepSchedulerConfig):
        milestones = tuple(scaled_steps(step, scale) for step in config.milestones)
        max_steps = scaled_steps(config.max_steps, scale)
        return dataclasses.replace(config, max_steps=max_steps, milestones=milestones)
    if isinstance(config, CosineDecaySchedulerConfig):
        warm_up_end = scaled_steps(config.warm_up_end, scale)
        max_steps = scaled_steps(config.max_steps, scale)
        return dataclasses.replace(config, warm_up_end=warm_up_end, max_steps=max_steps)
    if config is not None and scale != 1.0:
        CONSOLE.print(
            f"[yellow]{type(config).__name__} is not known here and keeps its steps; every other "
            f"schedule is scaled by {scale:g}."
        )
    return config


def scaled_optimizers(optimizers: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers` with each group's scheduler scaled."""
    return {
        name: {**group, "scheduler": scaled_scheduler(group.get("scheduler"), scale)}
        for name, group in optimizers.items()
    }


def follow(scheduler: LRScheduler, planned: Callable[[int], int | float]) -> None:
    """Let a scheduler go by the step that `planned` gives for the step at hand, from now on.

    A scheduler that is not made of functions of the step (torch's LambdaLR) keeps its steps.
    """
    if not isinstance(scheduler, LambdaLR):
        return
    curves: list[Any] = list(scheduler.lr_lambdas)
    scheduler.lr_lambdas = [_at(curve, planned) for curve in curves]
    factors = [curve(scheduler.last_epoch) for curve in scheduler.lr_lambdas]
    rates = [base * factor for base, factor in zip(scheduler.base_lrs, factors, strict=True)]
    for group, rate in zip(scheduler.optimizer.param_groups, rates, strict=True):
        group["lr"] = rate


def _at(curve: Callable[[int | float], float], planned: Callable[[int], int | float]):
    return lambda step: curve(planned(step))
