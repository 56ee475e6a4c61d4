"""What effects cost on this machine: steps of models that differ in nothing but what is on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import torch

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.calibration.timing import time_in_turns
from desplat_ns.settings.effects import Effects

MOST_PIXELS, MOST_GAUSSIANS = 200_000, 50_000
"""Larger photos and scenes are measured smaller, which takes seconds: ratios are what is asked."""

ROUNDS = 3


@dataclass(frozen=True)
class StepSize:
    """What a step was measured on."""

    width: int
    height: int
    num_gaussians: int

    @classmethod
    def for_photos(cls, width: int, height: int, num_photos: int, per_pixel: float) -> StepSize:
        """For photos of a size, of which each pixel gets so many static Gaussians."""
        wanted = per_pixel * width * height * num_photos
        shrink = min(1.0, math.sqrt(MOST_PIXELS / (width * height)))
        count = int(min(max(wanted, 1000), MOST_GAUSSIANS))
        return cls(max(16, round(shrink * width)), max(16, round(shrink * height)), count)


@dataclass(frozen=True)
class EffectsCost:
    """A step with some effects on."""

    effects: Effects
    milliseconds: float
    """Of a training step, wall time, the least of all turns: other programs only add to it."""
    ratio: float
    """Of that to a step with nothing on."""
    extra_bytes: int
    """Parameters and optimizer state beyond those of the static scene, no distractor placed."""

    def line(self) -> str:
        """For a console."""
        on = {k: v for k, v in asdict(self.effects).items() if v not in (False, "off")}
        what = ", ".join(k if v is True else f"{k} {v}" for k, v in on.items()) or "nothing on"
        megabytes = self.extra_bytes / 1e6
        return (
            f"{what}: {self.milliseconds:.0f} ms a step ({self.ratio:.2f} times as long as with "
            f"nothing on), {megabytes:.1f} MB more"
        )


def measure(
    size: StepSize, cases: Sequence[Effects], num_photos: int, rounds: int = ROUNDS
) -> list[EffectsCost]:
    """Time steps with the effects of each case, in turns with one that has none.

    On the GPU where there is one; seconds, and longer where kernels are to be compiled first.

    Raises:
        BackendUnavailableError: nothing draws on that GPU.
    """
    device = "cuda" if torch.cuda.is_available() else "cpu"
    scene = make_scene(size.num_gaussians, size.width, size.height)
    every = dict.fromkeys((Effects(distractors=False), *cases))
    steps = {effects: ModelStep(scene, effects, num_photos, device, "auto") for effects in every}
    timings = time_in_turns({str(e): step for e, step in steps.items()}, rounds)
    first = next(iter(every))
    least = {effects: min(timings[str(effects)].wall) for effects in every}
    base_bytes = steps[first].trained_bytes()
    return [
        EffectsCost(
            effects,
            least[effects],
            least[effects] / least[first],
            steps[effects].trained_bytes() - base_bytes,
        )
        for effects in every
    ]
