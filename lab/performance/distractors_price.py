"""The price of distractors: steps of `desplat` against steps of the static scene alone.

Both have the same static Gaussians, and a step is the trainer's with its bookkeeping (`WholeStep`,
which says what is left out; that new distractors are placed is left out, too). In a run's warm-up
only statistics are added; then regions are looked for, distractors drawn, and the static loss
leaves regions out. Photos have nothing in the way; or something that covers a share of their
middle, with distractors as they have just been placed; or 300 distractors over the whole of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from desplat_ns.calibration.model_step import ModelStep
from desplat_ns.calibration.timing import Timing, threads, time_in_turns
from desplat_ns.gaussians.distractors import ViewDistractors
from desplat_ns.rendering.views import view_of
from desplat_ns.separation.grid import grid_of, region_pixels
from desplat_ns.separation.placement import distractors_in
from desplat_ns.settings.effects import Effects
from lab.front.whole_step import SETTLED, Size, WholeStep

VIEWS = 5
PLACED = 300
"""Distractors of each view that has some."""

PHOTOS, COUNTS = ((180, 240), (270, 480), (800, 1200)), (10_000, 50_000, 200_000)
SIZES = tuple((count, *photo) for photo in PHOTOS for count in COUNTS)
"""Static Gaussians, width, height."""

WARM_UP, AFTER = "warm-up", "after"
WARM_UPS = {WARM_UP: SETTLED + 1, AFTER: 0}
"""Length of the warm-up with which `SETTLED` lies in a phase."""

COVERED = 0.15
"""Share of a photo, as in the study's captures."""

NONE, SOME, ALL = "none", f"{COVERED:.0%} covered", f"{PLACED} everywhere"

OFF = "off"
CASES: dict[str, tuple[str, str]] = {
    "warm-up": (NONE, WARM_UP),
    NONE: (NONE, AFTER),
    SOME: (SOME, AFTER),
    ALL: (ALL, AFTER),
}
"""What is in the way, and the phase."""


@dataclass(frozen=True)
class Price:
    """Steps of all cases on one scene."""

    scene: str
    threads: int
    steps: dict[str, Timing]
    """By case, `OFF` first."""

    def ratios(self, case: str) -> tuple[float, float]:
        """CPU and wall time of a case's step over that without distractors."""
        step, off = self.steps[case], self.steps[OFF]
        return step.cpu_ms / off.cpu_ms, step.wall_ms / off.wall_ms


def in_phase(step: WholeStep, phase: str) -> None:
    """Take a step as in a phase of a run."""
    layer = step.model.layer
    assert layer is not None
    layer.config = replace(layer.config, static_warmup=WARM_UPS[phase])
    step()


def put_in_the_way(step: ModelStep, share: float) -> None:
    """Let the photo show the scene of the first view, and noise over a share of its middle, where
    every view has distractors as they are when they have just been placed."""
    model, distractors = step.model, step.model.distractors
    assert distractors is not None
    config, view = model.config.distractors, view_of(step.camera)
    columns, rows = grid_of(view.width, view.height, config.per_view)
    across, down = (
        np.abs((np.arange(number) + 0.5) / number - 0.5) < math.sqrt(share) / 2
        for number in (columns, rows)
    )
    cells = down[:, None] & across
    covered = region_pixels(torch.from_numpy(cells), view.height, view.width)
    step.photo = torch.where(covered, step.photo, model(step.camera)["rgb_static"].detach())
    for index in range(len(distractors.views)):
        placed = distractors_in(cells, view, step.photo, config)
        distractors.views[index] = ViewDistractors(placed)
    distractors.total = sum(distractors.counts())


def cases_of(count: int, width: int, height: int) -> dict[str, Callable[[], None]]:
    """A step of each case."""
    size = Size(VIEWS, count, width, height, 0)
    off = WholeStep(size, effects=Effects(distractors=False))
    steps = {NONE: WholeStep(size), SOME: WholeStep(size)}
    steps[ALL] = WholeStep(replace(size, distractors=PLACED))
    put_in_the_way(steps[SOME], COVERED)
    return {OFF: off} | {
        name: partial(in_phase, steps[kind], phase) for name, (kind, phase) in CASES.items()
    }


def time_price(size: tuple[int, int, int], rounds: int, numbers: list[int]) -> Iterator[Price]:
    """Time all cases on one scene, with each number of threads."""
    count, width, height = size
    cases = cases_of(*size)
    for number in numbers:
        with threads(number):
            steps = time_in_turns(cases, rounds)
        yield Price(f"{width} x {height}, {count:,}", number, steps)
