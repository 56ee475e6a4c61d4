"""A study of a capture, training after training; ended at any time, it goes on where it was."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Lock

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.studies.capture_info import METHOD, describe_capture
from desplat_ns.studies.executors import Executor
from desplat_ns.studies.methods import method_config
from desplat_ns.studies.pace import (
    Clock,
    Pace,
    first_pace,
    fitting,
    plan_for,
)
from desplat_ns.studies.plan import BACKEND, TrainingPlan, compared
from desplat_ns.studies.results import RUNS, Results
from desplat_ns.studies.runs import Record, Run, log_of, remove_checkpoints


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
    results = Results.load(request.output)
    if results is None:
        started = time.monotonic()
        capture = describe_capture(request.data, request.parser, request.output)
        return Results(capture, time.monotonic() - started, request.jobs)
    capture = results.capture
    if (capture.data, capture.parser) != (str(request.data.resolve()), request.parser):
        options = " ".join((capture.data, *capture.parser))
        raise ConfigError(
            f"{request.output} holds the study of another capture or data parser: {options}. "
            "Name another --output, or that capture to go on with it."
        )
    results.jobs = request.jobs
    return results


class Session:
    """The work on a study from one start of the command to its end."""

    def __init__(self, request: Request, results: Results, tell: Callable[[str], None]) -> None:
        """Args:
        tell: is told what is being done.
        """
        self.results, self.clock = results, Clock(request.seconds, results.spent)
        self._folder, self._executor, self._tell = request.output, request.executor, tell
        self._runs = (request.output / RUNS).resolve()
        self._keeping = Lock()
        self.results.left_out = []
        self.save()

    def save(self) -> None:
        """Write results.json. Raises ConfigError where that cannot be done."""
        self.results.spent = round(self.clock.spent, 1)
        self.results.save(self._folder)

    def do(self) -> None:
        """The runs of the plan that are not done and for which time is left.

        Raises:
            ConfigError: not even one fits.
        """
        self._tell("timing of training steps")
        results, config = self.results, method_config(METHOD)
        pace = first_pace(results.capture, config.machine.device_type)
        if results.plan is None:
            names = tuple(name for name in compared(results.capture.effects) if name != BACKEND)
            most = config.nominal_num_iterations
            results.plan = plan_for(
                self.clock.left, results.jobs, pace, results.capture, names, most
            )
        runs = results.plan.runs(results.capture)
        done = {run for run in runs if run.name in results.training}
        for run in done:
            pace.add(run, results.training[run.name].figures["run_wall_seconds"])
        self._announce_plan(results.plan, len(runs), len(done))
        self._runs.mkdir(parents=True, exist_ok=True)
        coming = self._noted(fitting(runs, done, pace, self.clock))
        self._executor.do(coming, self._runs, partial(self._keep, pace))
        settled = results.training.keys() | results.failed.keys()
        results.left_out = [run.name for run in runs if run.name not in settled]
        self.save()

    def _noted(self, runs: Iterable[Run]) -> Iterator[Run]:
        for run in runs:
            self._tell(f"training: {run.variant.name}, {run.steps:,} steps, seed {run.seed}")
            yield run

    def _keep(self, pace: Pace, run: Run, outcome: Record | Exception) -> bool:
        """Record a run and make room; False if it failed, which is said.

        Raises:
            ConfigError: nothing can be written, for instance because the disk is full.
        """
        with self._keeping:  # runs beside each other share the results
            if isinstance(outcome, Exception):
                self._fail(run.name, outcome)
                self.save()
                return False
            pace.add(run, outcome.figures["run_wall_seconds"])
            self.results.training[run.name] = outcome
            self.results.failed.pop(run.name, None)
            self.save()
        psnr, seconds = outcome.figures["psnr"], outcome.figures["train_wall_seconds"]
        announce(f"{run.name}: {psnr:.2f} dB after {seconds:.0f} s of training")
        remove_checkpoints(run.name, self._runs)
        return True

    def _announce_plan(self, plan: TrainingPlan, number: int, done: int) -> None:
        went_on = f", {done} of which are done" if done else ""
        announce(
            f"Variants are compared at {plan.steps:,} steps. Planned: {number} trainings{went_on}; "
            "as many as fit are done."
        )

    def _fail(self, name: str, error: Exception) -> None:
        log = f"{type(error).__name__}: {error} Its log: {log_of(name, self._runs)}"
        said = str(error) if isinstance(error, DeSplatError) else log
        self.results.failed[name] = said
        announce(f"{name}: {said}", warning=True)
