"""How long the runs of a study take: guessed from timed steps, then from runs that are done."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median

from desplat_ns.calibration.run_plan import measure_costs
from desplat_ns.calibration.timing import threads
from desplat_ns.datamanager import training_split
from desplat_ns.errors import ConfigError
from desplat_ns.studies.grid.runs import Run
from desplat_ns.studies.grid.settings import parse
from desplat_ns.studies.tradeoff.plan import BACKEND, BASE, SCENE, SEEDS, SHORTEST, TrainingPlan
from desplat_ns.studies.tradeoff.subject import METHOD, Subject

START_SECONDS = 20.0
"""Of a run beside its steps, until one is done: imports, photos, evaluations."""

DEARER = {"appearance-affine": 2.5, BACKEND: 20.0}
"""Settings whose steps cost so many times the base's, until a run of theirs is done."""

BESIDE_OTHERS = 1.25
"""A step beside other jobs takes so many times what it takes alone, until a run is done."""

WANTED = 500
"""Steps of a comparison at least, if the time allows: of shorter runs little can be learned, so
that one seed, or fewer settings, have to do first."""

SHARE_OF_ONE = 0.1
"""Of the time that a single run of the comparison may take, where not all settings fit."""


@dataclass
class Clock:
    """Wall time of a study, those sittings included that were ended."""

    budget: float
    """Seconds."""
    earlier: float = 0.0
    """Seconds that earlier sittings took."""
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


class Pace:
    """Expected wall seconds of runs."""

    def __init__(self, step_seconds: float) -> None:
        """Args:
        step_seconds: of the base, timed alone.
        """
        self._guess = step_seconds * BESIDE_OTHERS
        self._steps: dict[str, list[float]] = {}
        self._starts: dict[str, list[float]] = {}

    def add(self, run: Run, seconds: float, training: float) -> None:
        """A run is done.

        Args:
            seconds: from its process's start to its end.
            training: those of its steps alone.
        """
        self._steps.setdefault(run.setting, []).append(training / run.steps)
        self._starts.setdefault(run.setting, []).append(max(0.0, seconds - training))

    def seconds(self, run: Run) -> float:
        """Expected of a run."""
        return self._start(run.setting) + run.steps * self._step(run.setting)

    def _step(self, setting: str) -> float:
        if setting in self._steps:
            return max(self._steps[setting])  # longer runs have more Gaussians
        base = max(self._steps.get(BASE, [self._guess]))
        return base * DEARER.get(setting, 1.0)

    def _start(self, setting: str) -> float:
        known = self._starts.get(setting) or self._starts.get(BASE)
        return median(known) if known else START_SECONDS


def first_pace(subject: Subject, device: str) -> Pace:
    """From training steps on generated Gaussians of this capture's size, one thread; seconds.

    Args:
        device: on which runs train.
    """
    config = parse(METHOD, ["--data", subject.data, *subject.parser])
    manager, model = config.pipeline.datamanager, config.pipeline.model
    manager.data = config.data
    model.effects = model.effects.decided(subject.effects)
    with threads(1):
        costs = measure_costs(training_split(manager), model, device)
    return Pace(costs.mean(model, subject.photos, config.nominal_num_iterations))


def plan_for(
    seconds: float, jobs: int, pace: Pace, settings: Sequence[str], most: int
) -> TrainingPlan:
    """The longest comparison of which all runs fit. If none of `WANTED` steps does, the longest of
    at most as many of which those of the first seed fit, or one run is no large part of the time.

    Args:
        seconds: of wall time, for trainings.
        jobs: runs beside each other.
        settings: names of what is compared, the base first.
        most: steps of the method itself.

    Raises:
        ConfigError: not even the shortest run of the base fits.
    """
    plan = TrainingPlan(SHORTEST, tuple(settings), most)
    first = pace.seconds(plan.runs()[0])
    if first > seconds:
        raise ConfigError(
            f"The study has {max(seconds, 0):.0f} s left for trainings, and the shortest, "
            f"{plan.runs()[0].steps} steps and their evaluation, is expected to take {first:.0f} "
            f"s here. Give --time {4 * first / 60:.0f}min or more, or smaller photos (the data "
            "parser's --downscale-factor)."
        )

    def fits(plan: TrainingPlan, seeds: tuple[int, ...]) -> bool:
        runs = [
            run
            for run in plan.runs()
            if run.seed in seeds and run.steps <= 4 * plan.steps and run.setting != BACKEND
        ]
        return sum(map(pace.seconds, runs)) <= seconds * jobs

    def is_short(plan: TrainingPlan) -> bool:
        one = pace.seconds(Run(BASE, SCENE, 1, plan.steps, SEEDS[0]))
        return one <= SHARE_OF_ONE * seconds * jobs

    plans = list(_longer(plan))
    whole = [one for one in plans if one.steps >= WANTED and fits(one, SEEDS)]
    parts = [
        one for one in plans if one.steps <= WANTED and (fits(one, SEEDS[:1]) or is_short(one))
    ]
    return (whole or parts or [plan])[-1]


def _longer(plan: TrainingPlan) -> Iterator[TrainingPlan]:
    """The plan, and those of doubled lengths."""
    steps = plan.steps
    while steps <= plan.most:
        yield TrainingPlan(steps, plan.settings, plan.most)
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
        found = next((run for run in waiting if pace.seconds(run) <= clock.left), None)
        if found is None:
            return
        waiting.remove(found)
        yield found
