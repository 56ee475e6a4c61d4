"""Learning rates: schedules in nominal steps, read at the clock of the run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from nerfstudio.engine.optimizers import Optimizers
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError
from desplat_ns.training.budget import Clock


def checked_schedules(optimizers: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers` whose exponential decays can be followed.

    A group whose rate is 0 is frozen: it has no schedule. Raises ConfigError where a rate is not
    positive, or where a warm-up does not end before the decay.
    """
    checked = dict(optimizers)
    for name, group in optimizers.items():
        lr, decay = group["optimizer"].lr, group.get("scheduler")
        if not isinstance(decay, ExponentialDecaySchedulerConfig):
            continue
        if lr < 0 or (decay.lr_final is not None and decay.lr_final <= 0):
            raise ConfigError(
                f"An exponential decay runs between positive learning rates; found lr {lr} and "
                f"lr-final {decay.lr_final}. Give a positive --optimizers.{name}.scheduler.lr-final"
                ", or lr 0 to freeze the group."
            )
        if decay.warmup_steps >= decay.max_steps:
            raise ConfigError(
                f"--optimizers.{name}.scheduler.warmup-steps is {decay.warmup_steps}; it has to be "
                f"below max-steps, {decay.max_steps}."
            )
        if lr == 0:
            checked[name] = {**group, "scheduler": None}
    return checked


def follow(scheduler: LRScheduler, clock: Clock) -> None:
    """Let a scheduler go by the nominal steps of a clock from now on.

    Rates are Python floats from then on: numpy scalars, which nerfstudio 1.1.5 returns, end up in
    the checkpoint, and torch >= 2.6 then refuses to load it. A scheduler that is not made of
    functions of the step (torch's LambdaLR) keeps the run's own steps, which is said.
    """
    if not isinstance(scheduler, LambdaLR):
        announce(f"{type(scheduler).__name__} goes by the steps of the run itself.", warning=True)
        return
    curves: list[Any] = list(scheduler.lr_lambdas)
    scheduler.lr_lambdas = [_read_at(clock, curve) for curve in curves]
    set_position(scheduler, scheduler.last_epoch)


def multiply_rates(
    optimizers: Optimizers, groups: Iterable[str], factor: Callable[[int], float]
) -> None:
    """Multiply the rates of `groups` by a factor of the run's step, whatever else they follow."""
    for name in groups:
        optimizer = optimizers.optimizers.get(name)
        if optimizer is None:
            continue
        if name not in optimizers.schedulers:
            optimizers.schedulers[name] = LambdaLR(optimizer, lambda step: 1.0)
        scheduler = optimizers.schedulers[name]
        if isinstance(scheduler, LambdaLR):
            curves: list[Any] = list(scheduler.lr_lambdas)
            scheduler.lr_lambdas = [_product(curve, factor) for curve in curves]
            set_position(scheduler, scheduler.last_epoch)


def _product(
    curve: Callable[[int], float], factor: Callable[[int], float]
) -> Callable[[int], float]:
    return lambda step: curve(step) * factor(step)


def _read_at(clock: Clock, curve: Callable[[int], float]) -> Callable[[int], float]:
    return lambda step: float(curve(clock.nominal(step)))


def set_position(scheduler: LambdaLR, steps_done: int) -> None:
    """Put a scheduler, and the rates of its optimizer, where they are after so many steps."""
    scheduler.last_epoch, scheduler._step_count = steps_done, steps_done + 1
    rates = [
        base * curve(steps_done)
        for base, curve in zip(scheduler.base_lrs, scheduler.lr_lambdas, strict=True)
    ]
    for group, rate in zip(scheduler.optimizer.param_groups, rates, strict=True):
        group["lr"] = rate
    scheduler._last_lr = rates
