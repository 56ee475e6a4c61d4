"""What a budget of wall time buys on this machine: steps and the size of the photos."""

from __future__ import annotations

from dataclasses import dataclass, replace

from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.calibration.timing import time_in_turns
from desplat_ns.errors import ConfigError
from desplat_ns.model import DeSplatModelConfig
from desplat_ns.training.budget import END_SECONDS, BudgetState, StepSeconds
from desplat_ns.training.resume import restore_rng, rng_state

MOST_PIXELS = 500_000
"""Larger photos are measured smaller, and what they cost follows from their pixels."""

MOST_GAUSSIANS = 100_000
"""Larger sets likewise; a step's fixed cost is taken to grow with their number."""

USUAL_PER_PIXEL = 0.05
"""Static Gaussians per pixel of all photos, where a run has no limit: that of `desplat`."""

MOST_GROWTH = 7
"""Static Gaussians in the end for each point at the start: the most on any capture of
docs/results/quality.md and docs/results/speed.md, in 1,000 steps (2.4 on `fox_cluttered`, 5.6 on
`sacre_coeur`, 6.7 on `yard40`)."""

ROUNDS = 2

STEPS_WANTED = 500
"""Photos are trained on at a smaller size where fewer steps than this would fit."""

FEWEST_STEPS = 200
"""A run of fewer is refused, unless fewer are asked for: schedules have warm-ups of a few steps."""

SMALLEST = 4
"""Photos are at most this many times smaller in the whole run."""

PLACED = 1.15
"""Factor on a step for the distractors that will be placed, which the measured step has not."""

SAMPLED_STEPS = 1_000
"""Length of the run whose sizes of photos stand for those of any length."""


def expected_gaussians(outputs: DataparserOutputs, model: DeSplatModelConfig, device: str) -> int:
    """Static Gaussians at the end of a run: as many as may be, or as `desplat` lets be, or as grow
    of the points at the start. Arguments as `measure_step`'s."""
    pixels = int((outputs.cameras.width * outputs.cameras.height).sum())
    most = min(model.most_gaussians(pixels, device), max(1, round(USUAL_PER_PIXEL * pixels)))
    points = outputs.metadata.get("points3D_xyz")
    return most if points is None else min(most, max(1, MOST_GROWTH * len(points)))


def measure_step(outputs: DataparserOutputs, model: DeSplatModelConfig, device: str) -> StepSeconds:
    """Time training steps on a generated scene of this capture's size, with its effects.

    Wall time, with the threads and the device that training will have; seconds, and half a minute
    more where kernels are to be compiled. The random generators are left as they were.

    Args:
        outputs: of the training split.
        model: with its effects decided.
        device: on which it trains.
    """
    cameras = outputs.cameras
    width, height = int(cameras.width.median()), int(cameras.height.median())
    expected = expected_gaussians(outputs, model, device)
    count = min(max(expected, 1000), MOST_GAUSSIANS)
    shrink = min(1.0, (MOST_PIXELS / (width * height)) ** 0.5)
    effects, randomness = model.effects.settled(), rng_state()
    steps = {}
    for factor in (1, 2):
        size = [max(16, round(shrink * side / factor)) for side in (width, height)]
        steps[str(factor)] = ModelStep(
            make_scene(count, *size), effects, len(cameras), device, model.backend
        )
    timings = time_in_turns(steps, ROUNDS)
    restore_rng(randomness)
    whole, half = (min(timings[name].wall) / 1e3 for name in steps)  # other programs only add
    measured = StepSeconds.through(whole, half)
    placed = PLACED if effects.distractors else 1.0
    return StepSeconds(
        measured.fixed * max(1.0, expected / count) * placed,
        measured.whole_photo / shrink**2 * placed,
    )


@dataclass(frozen=True)
class StepCost:
    """What each step of a run is expected to take: photos and the set are small at first."""

    seconds: StepSeconds
    """With photos of full size and the whole set."""
    share_at_start: float
    """Gaussians in the beginning, of those in the end."""

    def at(self, run: DeSplatModelConfig, step: int) -> float:
        """Seconds of a nominal step of `run`, settings as `for_run` gives them."""
        grown = self.share_at_start + (1 - self.share_at_start) * step / max(1, run.stop_split_at)
        seconds = self.seconds
        return seconds.fixed * min(1.0, grown) + seconds.of_pixels(run.downscale_factor(step))

    def mean(self, model: DeSplatModelConfig, num_views: int, nominal: int) -> float:
        """Seconds of a step, on average over a run of `SAMPLED_STEPS`."""
        scale = min(1.0, SAMPLED_STEPS / nominal)
        run = replace(model, schedule_scale=scale).for_run(num_views)
        return (
            sum(self.at(run, round(step / scale)) for step in range(SAMPLED_STEPS)) / SAMPLED_STEPS
        )


def measure_costs(outputs: DataparserOutputs, model: DeSplatModelConfig, device: str) -> StepCost:
    """What steps of a run on this capture cost on this machine; arguments as `measure_step`'s."""
    most = expected_gaussians(outputs, model, device)
    points = outputs.metadata.get("points3D_xyz")
    start = most if points is None else len(points)
    return StepCost(measure_step(outputs, model, device), min(1.0, start / most))


def plan_run(
    budget: float,
    spent: float,
    model: DeSplatModelConfig,
    num_views: int,
    lengths: tuple[int, int],
    cost: StepCost,
) -> BudgetState:
    """How many steps fit, and with photos of which size.

    Args:
        budget, spent: seconds, in all and until now.
        lengths: the most steps that are wanted, and the method's own number.
        cost: of the steps.

    Raises:
        ConfigError: too few steps fit.
    """
    most, nominal = lengths
    left = budget - spent - END_SECONDS
    downscale = model.train_downscale
    while True:
        a_step = cost.mean(replace(model, train_downscale=downscale), num_views, nominal)
        steps = min(most, int(left / a_step))
        if steps >= min(STEPS_WANTED, most) or downscale >= SMALLEST:
            break
        downscale *= 2
    fewest = min(FEWEST_STEPS, most)
    if steps < fewest:
        needed = spent + END_SECONDS + 1.2 * fewest * a_step
        raise ConfigError(
            f"--budget is {budget:.0f} s, of which {spent:.0f} s went into the start. A step takes "
            f"{1e3 * a_step:.0f} ms here with photos {downscale} times smaller, so that only "
            f"{max(0, steps)} fit, and a run needs {fewest}. Give {needed:.0f}s or more, or "
            "smaller photos (the data parser's --downscale-factor)."
        )
    return BudgetState(steps, downscale, most)
