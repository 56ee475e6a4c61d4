"""What effects cost on this machine: steps of models that differ in nothing but what is on."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.calibration.timing import Timing, time_in_turns
from desplat_ns.settings.effects import Effects
from desplat_ns.training.resume import restore_rng, rng_state

MOST_PIXELS, MOST_GAUSSIANS = 200_000, 50_000
"""Larger photos and scenes are measured smaller, which takes seconds: ratios are what is asked."""

ROUNDS = 5

WIDE = 1.25
"""The middle half of the rounds' ratios spans a larger factor: something else disturbed them."""


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
    """Of a training step, median of the rounds: CPU time of all threads, on a GPU wall time."""
    ratio: float
    """Of that to a step with nothing on in the same round, median of the rounds."""
    ratio_range: tuple[float, float]
    """The quarter and three quarters of the rounds' ratios."""
    extra_bytes: int
    """Parameters and optimizer state beyond those of the static scene, no distractor placed."""

    def words(self) -> str:
        """For a console: the time of the step, beside that with nothing on."""
        if not self.effects.words:
            return f"{self.milliseconds:.0f} ms with nothing on"
        low, high = self.ratio_range
        doubt = f" (not steady: {low:.2f} to {high:.2f})" if self.is_wide else ""
        return f"{self.ratio:.2f} times as long with {self.effects.words}{doubt}"

    @property
    def is_wide(self) -> bool:
        """Whether the rounds do not agree, for instance because other programs ran beside."""
        return self.ratio_range[1] > WIDE * self.ratio_range[0]


def measure(
    size: StepSize, cases: Sequence[Effects], num_photos: int, rounds: int = ROUNDS
) -> list[EffectsCost]:
    """Time steps with the effects of each case, in turns with one that has none.

    On the GPU where there is one; seconds, and longer where kernels are to be compiled first. The
    random generators are left as they were.

    Raises:
        BackendUnavailableError: nothing draws on that GPU.
    """
    device = "cuda" if torch.cuda.is_available() else "cpu"
    scene = make_scene(size.num_gaussians, size.width, size.height)
    every = dict.fromkeys((Effects(distractors=False), *cases))
    randomness = rng_state()
    steps = {effects: ModelStep(scene, effects, num_photos, device, "auto") for effects in every}
    timings = time_in_turns({str(e): step for e, step in steps.items()}, rounds)
    restore_rng(randomness)
    first = next(iter(every))
    each = {effects: _by_round(timings[str(effects)], device, rounds) for effects in every}
    ratios = {
        e: [seconds / base for seconds, base in zip(each[e], each[first], strict=True)]
        for e in each
    }
    base_bytes = steps[first].model.trained_bytes()
    return [
        EffectsCost(
            effects,
            statistics.median(each[effects]),
            statistics.median(ratios[effects]),
            _middle_half(ratios[effects]),
            steps[effects].model.trained_bytes() - base_bytes,
        )
        for effects in every
    ]


def _by_round(timing: Timing, device: str, rounds: int) -> list[float]:
    """Milliseconds of each round, the median of its calls.

    CPU time does not count what other programs take; a GPU's work is in the wall time alone.
    """
    spent = timing.wall if device == "cuda" else timing.cpu
    calls = len(spent) // rounds
    return [statistics.median(spent[i * calls : (i + 1) * calls]) for i in range(rounds)]


def _middle_half(values: Sequence[float]) -> tuple[float, float]:
    low, high = torch.tensor(values).quantile(torch.tensor([0.25, 0.75])).tolist()
    return low, high
