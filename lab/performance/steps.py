"""Time training steps: the product's against the one with yardstick, pytorch_msssim, plain Adam."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from pytorch_msssim import ssim as msssim_ssim
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from desplat_ns.backend.ssim import ssim
from desplat_ns.calibration.scenes import Scene
from desplat_ns.calibration.timing import Timing, threads, time_in_turns
from lab.performance.training_step import OTHER, PARTS, Clock, TrainingStep
from lab.performance.yardstick import YARDSTICK
from lab.pixels.contenders import Contender

EPS = 1e-15
"""Of Adam, as in nerfstudio's configuration of Splatfacto."""


@dataclass(frozen=True)
class StepTimes:
    """One kind of step on one scene."""

    scene: str
    name: str
    threads: int
    whole: Timing
    """Uninterrupted."""
    parts: dict[str, float]
    """CPU milliseconds, medians; `other` makes up the rest of `whole`."""

    @property
    def share_explained(self) -> float:
        """Sum of the parts over the uninterrupted step."""
        return 1 - self.parts[OTHER] / self.whole.cpu_ms


def product_adam(name: str, parameter: nn.Parameter) -> Optimizer:
    """Adam as the registered method configures it."""
    from desplat_ns.method_configs import static_optimizers  # takes seconds: not for `--help`

    return static_optimizers()[name]["optimizer"].setup(params=[parameter])


def plain_adam(name: str, parameter: nn.Parameter) -> Optimizer:
    """torch's default Adam."""
    return Adam([parameter], lr=1e-3, eps=EPS, fused=False)


def plain_ssim(pred: Tensor, target: Tensor) -> Tensor:
    """pytorch_msssim's, called as Splatfacto calls it."""
    planes = (image.permute(2, 0, 1)[None] for image in (target, pred))
    return msssim_ssim(*planes, data_range=1.0, size_average=True)


def time_steps(
    scene: Scene, contenders: list[Contender], number: int, rounds: tuple[int, int]
) -> list[StepTimes]:
    """Time the steps of all contenders that have parts, with `number` threads."""
    steps = {}
    for c in contenders:
        if c.name == YARDSTICK.name:
            steps[c.name] = TrainingStep(scene, c, plain_ssim, plain_adam)
        elif c.has_seams:
            steps[c.name] = TrainingStep(scene, c, ssim, product_adam)
    clocks: dict[str, list[Clock]] = {name: [] for name in steps}
    cases: dict[str, Callable[[], object]] = {}
    for name, step in steps.items():
        cases[name] = step.whole
        cases[f"{name}, in parts"] = _keeping(step.in_parts, clocks[name])
    with threads(number):
        wholes = time_in_turns(cases, *rounds)
    return [
        StepTimes(scene.name, name, number, wholes[name], _medians(clocks[name], wholes[name]))
        for name in steps
    ]


def _keeping(step: Callable[[], Clock], clocks: list[Clock]) -> Callable[[], None]:
    return lambda: clocks.append(step())


def _medians(clocks: list[Clock], whole: Timing) -> dict[str, float]:
    """Of every part over all steps but the first, which may compile; and the rest."""
    medians = {part: statistics.median(c.ms[part] for c in clocks[1:]) for part in PARTS}
    return {**medians, OTHER: whole.cpu_ms - sum(medians.values())}


def time_adam(scene: Scene, rounds: int) -> dict[str, Timing]:
    """One Adam step over all parameters of a scene: fused, plain, and as the product has it."""
    cases: dict[str, Callable[[], object]] = {}
    makers: Mapping[str, Callable[[str, nn.Parameter], Optimizer]] = {
        "fused": lambda _, p: Adam([p], lr=1e-3, eps=EPS, fused=True),
        "not fused": plain_adam,
        "as configured": product_adam,
    }
    for name, make in makers.items():
        parameters = {key: nn.Parameter(t.clone()) for key, t in scene.params.items()}
        for parameter in parameters.values():
            parameter.grad = torch.full_like(parameter, 1e-3)
        optimizers = [make(key, p) for key, p in parameters.items()]
        cases[name] = _all_steps(optimizers)
    with threads(1):
        return time_in_turns(cases, rounds)


def _all_steps(optimizers: list[Optimizer]) -> Callable[[], None]:
    def step() -> None:
        for optimizer in optimizers:
            optimizer.step()

    return step
