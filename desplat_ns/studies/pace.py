"""How long the runs of a study take: guessed from timed steps, then from runs that are done."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import fmean, linear_regression

from desplat_ns.calibration.run_plan import measure_costs
from desplat_ns.calibration.timing import threads
from desplat_ns.datamanager import training_split
from desplat_ns.errors import ConfigError
from desplat_ns.studies.capture_info import METHOD, CaptureInfo
from desplat_ns.studies.methods import parse
from desplat_ns.studies.plan import BACKEND, BASE, SEEDS, SHORTEST, TrainingPlan
from desplat_ns.studies.runs import Run

START_SECONDS = 20.0
"""Of a run beside its steps, until one is done: imports, photos, evaluations."""

DEARER = {"appearance-affine": 2.5, BACKEND: 20.0}
"""Variants whose steps cost so many times the base's, until a run of theirs is done."""

BESIDE_OTHERS = 1.25
"""A step beside other jobs takes so many times what it takes alone, until a run is done."""

WANTED = 500
"""Steps of a comparison at least, if the time allows: of shorter runs little can be learned, so
that one seed, or fewer variants, have to do first."""

SHARE_OF_ONE = 0.1
"""Of the time that a single run of the comparison may take, where not all variants fit."""


@dataclass
class Clock:
    """Wall time of a study, those sessions included that were ended."""

    budget: float
    """Seconds."""
    earlier: float = 0.0
    """Seconds that earlier sessions took."""
    _start: float = field(default_factory=lambda: Clock._now())

    _now = staticmethod(time.monotonic)

    @property
    def spent(self) -> float:
        """Seconds."""
        return self.earlier + self._now() - self._start

    @property
    def left(self) -> float:
        """Seconds; below 0 once the time is up."""
        return self.budget - self.spent


Line = tuple[float, float]
"""Seconds of a run beside its steps, and of a step."""


class Pace:
    """Expected wall seconds of runs, from the start of a process to its end.

    A run takes a + b steps: a is for imports, reading photos, the last checkpoint and evaluations,
    b for a step. Runs of two lengths of a variant give both, by least squares. Until then they are
    the base's, or at first a guess, times a factor that fits the runs that are done.
    """

    def __init__(self, step_seconds: float) -> None:
        """Args:
        step_seconds: of the base, timed alone.
        """
        self._guess: Line = START_SECONDS, step_seconds * BESIDE_OTHERS
        self._done: dict[str, list[tuple[int, float]]] = {}

    def add(self, run: Run, seconds: float) -> None:
        """A run is done.

        Args:
            seconds: from its process's start to its end.
        """
        self._done.setdefault(run.variant.name, []).append((run.steps, seconds))

    def seconds(self, run: Run) -> float:
        """Expected of a run."""
        return self.expected(run.variant.name, run.steps)

    def expected(self, name: str, steps: int) -> float:
        """The same of a variant's name and a number of steps."""
        start, step = self._line(name)
        return start + steps * step

    def _line(self, name: str) -> Line:
        done = self._done.get(name, [])
        if len({steps for steps, _ in done}) > 1:
            return fitted(done)
        start, step = self._guess if name == BASE else self._line(BASE)
        if not done:
            return start, step * DEARER.get(name, 1.0)
        expected = sum(start + steps * step for steps, _ in done)
        factor = sum(seconds for _, seconds in done) / expected
        return factor * start, factor * step


def fitted(done: Sequence[tuple[int, float]]) -> Line:
    """The line through (steps, seconds) of runs, of several lengths, with the least squares; its
    slope and its start are not below 0."""
    slope, start = linear_regression(*zip(*done, strict=True))
    if slope < 0:  # what else the machine did outweighs the steps
        return fmean(seconds for _, seconds in done), 0.0
    if start < 0:
        return 0.0, sum(s * n for n, s in done) / sum(n * n for n, _ in done)
    return start, slope


def first_pace(capture: CaptureInfo, device: str) -> Pace:
    """From training steps on generated Gaussians of this capture's size, one thread; seconds.

    Args:
        device: on which runs train.
    """
    config = parse(METHOD, ["--data", capture.data, *capture.parser])
    manager, model = config.pipeline.datamanager, config.pipeline.model
    manager.data = config.data
    model.effects = model.effects.decided(capture.effects)
    with threads(1):
        costs = measure_costs(training_split(manager), model, device)
    return Pace(costs.mean(model, capture.photos, config.nominal_num_iterations))


def plan_for(
    seconds: float, jobs: int, pace: Pace, capture: CaptureInfo, variants: Sequence[str], most: int
) -> TrainingPlan:
    """The longest comparison of which all runs fit. If none of `WANTED` steps does, the longest of
    at most as many of which those of the first seed fit, or one run is no large part of the time.

    Args:
        seconds: of wall time, for trainings.
        jobs: runs beside each other.
        variants: names of what is compared, the base first.
        most: steps of the method itself.

    Raises:
        ConfigError: not even the shortest run of the base fits.
    """
    plan = TrainingPlan(SHORTEST, tuple(variants), most)
    shortest = plan.runs(capture)[0]
    first = pace.seconds(shortest)
    if first > seconds:
        raise ConfigError(
            f"The study has {max(seconds, 0):.0f} s left for trainings, and the shortest, "
            f"{shortest.steps} steps and their evaluation, is expected to take {first:.0f} "
            f"s here. Give --time {4 * first / 60:.0f}min or more, or smaller photos (the data "
            "parser's --downscale-factor)."
        )

    def fits(plan: TrainingPlan, seeds: tuple[int, ...]) -> bool:
        runs = [
            run
            for run in plan.runs(capture)
            if run.seed in seeds and run.steps <= 4 * plan.steps and run.variant.name != BACKEND
        ]
        return sum(map(pace.seconds, runs)) <= seconds * jobs

    def is_short(plan: TrainingPlan) -> bool:
        return pace.expected(BASE, plan.steps) <= SHARE_OF_ONE * seconds * jobs

    plans = list(_longer(plan))
    whole = [plan for plan in plans if plan.steps >= WANTED and fits(plan, SEEDS)]
    parts = [
        plan for plan in plans if plan.steps <= WANTED and (fits(plan, SEEDS[:1]) or is_short(plan))
    ]
    return (whole or parts or [plan])[-1]


def _longer(plan: TrainingPlan) -> Iterator[TrainingPlan]:
    """The plan, and those of doubled lengths."""
    steps = plan.steps
    while steps <= plan.most:
        yield TrainingPlan(steps, plan.variants, plan.most)
        steps *= 2


def fitting(runs: Sequence[Run], done: set[Run], pace: Pace, clock: Clock) -> Iterator[Run]:
    """The runs that are not done yet, in order, as long as they are expected to end in time.

    One that does not fit is passed over: shorter ones behind it may. `pace` and `clock` are asked
    when a run is.

    Args:
        done: is left as it is.
    """
    waiting = [run for run in runs if run not in done]
    while True:
        run = next((run for run in waiting if pace.seconds(run) <= clock.left), None)
        if run is None:
            return
        waiting.remove(run)
        yield run
