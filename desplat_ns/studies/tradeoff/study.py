"""A study of a capture, training after training; ended at any time, it goes on where it was."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.studies.grid import records
from desplat_ns.studies.grid.execute import config_of, log_of
from desplat_ns.studies.grid.executors import Executor
from desplat_ns.studies.grid.records import Record, Records, State
from desplat_ns.studies.grid.runs import Run, Study
from desplat_ns.studies.grid.settings import method_config
from desplat_ns.studies.tradeoff.pace import (
    START_SECONDS,
    Clock,
    Pace,
    first_pace,
    fitting,
    plan_for,
)
from desplat_ns.studies.tradeoff.plan import BACKEND, TrainingPlan, compared, study_of
from desplat_ns.studies.tradeoff.results import RECORDS, RUNS, Results
from desplat_ns.studies.tradeoff.subject import METHOD, subject_of

CHECKPOINTS = "nerfstudio_models"
"""nerfstudio's folder in a run."""


@dataclass(frozen=True)
class Request:
    """What a user asks for."""

    data: Path
    parser: tuple[str, ...]
    """Name and options of the data parser, as `ns-train` takes them."""
    output: Path
    seconds: float
    """Of wall time, for the whole study."""
    jobs: int
    """Runs beside each other."""
    executor: Executor


def open_study(request: Request) -> Results:
    """What an output folder holds of this study, or a new one.

    Raises:
        CaptureError: the capture cannot be read, or nothing of it is held out.
        ConfigError: the folder holds another study, or something else.
    """
    found = Results.load(request.output)
    if found is None:
        started = time.monotonic()
        subject = subject_of(request.data, request.parser, request.output)
        return Results(subject, time.monotonic() - started, request.jobs)
    subject = found.subject
    if (subject.data, subject.parser) != (str(request.data.resolve()), request.parser):
        options = " ".join((subject.data, *subject.parser))
        raise ConfigError(
            f"{request.output} holds the study of another capture or data parser: {options}. "
            "Name another --output, or that capture to go on with it."
        )
    found.jobs = request.jobs
    return found


class Sitting:
    """The work on a study from one start of the command to its end."""

    def __init__(self, request: Request, results: Results, tell: Callable[[str], None]) -> None:
        """Args:
        tell: is told what is being done.
        """
        self.results, self.clock = results, Clock(request.seconds, results.spent)
        self._folder, self._executor, self._tell = request.output, request.executor, tell
        self._runs = (request.output / RUNS).resolve()
        self._begun: dict[Run, float] = {}
        self.results.left_out = []
        self.save()

    @property
    def records(self) -> Records:
        """Of the trainings."""
        return records.load(self._folder / RECORDS)

    def save(self) -> None:
        """Write results.json. Raises ConfigError where that cannot be done."""
        self.results.spent = round(self.clock.spent, 1)
        self.results.save(self._folder, self.records)

    def do(self) -> None:
        """The runs of the plan that are not done and for which time is left.

        Raises:
            ConfigError: not even one fits.
        """
        self._tell("timing of training steps")
        results, config = self.results, method_config(METHOD)
        pace = first_pace(results.subject, config.machine.device_type)
        if results.plan is None:
            names = tuple(name for name in compared(results.subject.effects) if name != BACKEND)
            most = config.max_num_iterations
            results.plan = plan_for(self.clock.left, results.jobs, pace, names, most)
        study = study_of(results.subject, results.plan)
        done = set(self._known(study, pace))
        self._announce_plan(results.plan, len(study.plan), len(done))

        def keep(run: Run, found: Record | Exception) -> bool:
            return self._keep(study, pace, run, found)

        coming = self._noted(fitting(study.plan, done, pace, self.clock))
        self._runs.mkdir(parents=True, exist_ok=True)
        self._executor.do(study, coming, self._runs, keep)
        measured = self.records
        results.left_out = [
            run.name
            for run in study.plan
            if run.name not in measured and run.name not in results.failed
        ]
        self.save()

    def _known(self, study: Study, pace: Pace) -> Iterator[Run]:
        """Runs that earlier sittings did, with today's settings."""
        known = self.records
        for run in study.plan:
            if records.state_of(study, run, known)[0] in (State.DONE, State.DIRTY):
                training = known[run.name].figures["train_wall_seconds"]
                pace.add(run, training + START_SECONDS)
                yield run

    def _noted(self, runs: Iterable[Run]) -> Iterator[Run]:
        for run in runs:
            self._begun[run] = self.clock.spent
            self._tell(f"training: {run.setting}, {run.steps:,} steps, seed {run.seed}")
            yield run

    def _keep(self, study: Study, pace: Pace, run: Run, found: Record | Exception) -> bool:
        """Record a run and make room; False if it failed, which is said.

        Raises:
            ConfigError: nothing can be written, for instance because the disk is full.
        """
        if isinstance(found, Record):
            try:
                records.enter(self._folder / RECORDS, run, found)
            except OSError as error:
                found = error
        if isinstance(found, Exception):
            log = "" if isinstance(found, DeSplatError) else f" Its log: {log_of(run, self._runs)}"
            self._fail(run.name, found, log)
            self.save()
            return False
        training = found.figures["train_wall_seconds"]
        pace.add(run, self.clock.spent - self._begun[run])
        self.results.failed.pop(run.name, None)
        announce(f"{run.name}: {found.figures['psnr']:.2f} dB after {training:.0f} s of training")
        models = config_of(study, run, self._runs).with_name(CHECKPOINTS)
        shutil.rmtree(models, ignore_errors=True)
        self.save()
        return True

    def _announce_plan(self, plan: TrainingPlan, number: int, done: int) -> None:
        went_on = f", {done} of which are done" if done else ""
        announce(
            f"Settings are compared at {plan.steps:,} steps. Planned: {number} trainings{went_on}; "
            "as many as fit are done."
        )

    def _fail(self, name: str, error: Exception, more: str = "") -> None:
        said = str(error) if isinstance(error, DeSplatError) else f"{type(error).__name__}: {error}"
        self.results.failed[name] = f"{said}{more}"
        announce(f"{name}: {said}{more}", warning=True)
