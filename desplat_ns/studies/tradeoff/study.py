"""A study of a capture, level after level; ended at any time, it goes on where it was."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from desplat_ns.calibration.run_plan import expected_gaussians
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.studies.grid import records
from desplat_ns.studies.grid.execute import config_of, log_of
from desplat_ns.studies.grid.executors import Executor
from desplat_ns.studies.grid.records import Figures, Record, Records, State
from desplat_ns.studies.grid.runs import Run, Study
from desplat_ns.studies.grid.settings import method_config
from desplat_ns.studies.pixels.dial_study import measure_dials
from desplat_ns.studies.tradeoff.evaluation_level import (
    STEPS,
    run_of,
    scores_as_trained,
    scores_by_steps,
    steps_in,
    with_embeddings,
)
from desplat_ns.studies.tradeoff.pace import (
    START_SECONDS,
    Clock,
    Pace,
    first_pace,
    fitting,
    plan_for,
)
from desplat_ns.studies.tradeoff.plan import (
    BACKEND,
    Compared,
    TrainingPlan,
    compared,
    grades,
    study_of,
)
from desplat_ns.studies.tradeoff.results import RECORDS, RUNS, Results
from desplat_ns.studies.tradeoff.subject import METHOD, Subject, subject_of

PIXELS_SHARE, MOST_FOR_PIXELS = 0.1, 180.0
"""Of the time, and seconds at most, for the comparison of rasterizers."""

MOST_PIXELS, MOST_GAUSSIANS = 200_000, 100_000
"""Of the drawings that are compared."""

EVALUATION_SHARE = 0.1
"""Of the time, kept for the evaluation level."""

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


def drawn_size(subject: Subject) -> tuple[int, int, int]:
    """Gaussians, width and height of a drawing as a long run of a capture makes it, if it is not
    too large to be drawn in double precision."""
    pixels = subject.width * subject.height
    count = expected_gaussians(subject.photos * pixels, method_config(METHOD).pipeline.model)
    shrink = min(1.0, (MOST_PIXELS / pixels) ** 0.5)
    width, height = (max(16, round(shrink * side)) for side in (subject.width, subject.height))
    return min(count, MOST_GAUSSIANS), width, height


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

    @property
    def compared(self) -> dict[str, Compared]:
        """The settings."""
        return compared(self.results.subject.effects)

    def save(self) -> None:
        """Write results.json. Raises ConfigError where that cannot be done."""
        self.results.spent = round(self.clock.spent, 1)
        self.results.save(self._folder, self.records)

    def do(self) -> None:
        """All levels, each as far as there is time."""
        self.compare_rasterizers()
        self.train()
        self.score_again()

    # --- pixels ----------------------------------------------------------------------------------

    def compare_rasterizers(self) -> None:
        """The pixels level, unless it is done."""
        if self.results.pixels is not None:
            return
        self._tell("rasterizers")
        seconds = min(PIXELS_SHARE * self.clock.budget, MOST_FOR_PIXELS)

        def tell(case: str) -> None:
            self._tell(f"rasterizers: {case}")

        try:
            scene = make_scene(*drawn_size(self.results.subject))
            self.results.pixels = asdict(measure_dials(scene, seconds, tell))
            self.results.failed.pop("pixels", None)
        except Exception as error:  # the other levels do not need it
            self._fail("pixels", error)
        self.save()

    # --- training --------------------------------------------------------------------------------

    def train(self) -> None:
        """The training level: the runs of the plan that are not done and for which time is left.

        Raises:
            ConfigError: not even one fits.
        """
        self._tell("timing of training steps")
        results, config = self.results, method_config(METHOD)
        pace = first_pace(results.subject, config.machine.device_type)
        share = 1 - EVALUATION_SHARE if with_embeddings(self.compared) else 1.0
        until = Clock(share * self.clock.budget, self.clock.spent)
        if results.plan is None:
            names = tuple(name for name in self.compared if name != BACKEND)
            most = config.max_num_iterations
            results.plan = plan_for(until.left, results.jobs, pace, names, most)
        study = study_of(results.subject, results.plan)
        done = set(self._known(study, pace))
        self._announce_plan(results.plan, len(study.plan), len(done))

        def keep(run: Run, found: Record | Exception) -> bool:
            return self._keep(study, pace, run, found)

        coming = self._noted(fitting(study.plan, done, pace, until))
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
                pace.add(run, training + START_SECONDS, training)
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
        took, training = self.clock.spent - self._begun[run], found.figures["train_wall_seconds"]
        pace.add(run, took, training)
        self.results.failed.pop(run.name, None)
        announce(f"{run.name}: {found.figures['psnr']:.2f} dB after {training:.0f} s of training")
        if not self._is_scored_again(run):
            models = config_of(study, run, self._runs).with_name(CHECKPOINTS)
            shutil.rmtree(models, ignore_errors=True)
        self.save()
        return True

    def _is_scored_again(self, run: Run) -> bool:
        assert self.results.plan is not None
        return run == run_of(run.setting, self.results.plan.steps) and (
            run.setting in with_embeddings(self.compared)
        )

    def _announce_plan(self, plan: TrainingPlan, number: int, done: int) -> None:
        went_on = f", {done} of which are done" if done else ""
        announce(
            f"Settings are compared at {plan.steps:,} steps. Planned: {number} trainings{went_on}; "
            "as many as fit are done."
        )

    # --- evaluation ------------------------------------------------------------------------------

    def score_again(self) -> None:
        """The evaluation level: settings of each grade, some with several numbers of steps."""
        results, known = self.results, self.records
        assert results.plan is not None
        study, steps = study_of(results.subject, results.plan), results.plan.steps
        lit = with_embeddings(self.compared)
        plain = [name for name in grades(self.compared) if name not in lit]
        kept = [one for one in results.evaluation if one["steps"] is not None]
        kept += map(asdict, scores_as_trained(plain, steps, known))
        for name in lit:
            label = f"evaluation of {name}"
            record = known.get(run_of(name, steps).name)
            known_of = [one for one in kept if one["setting"] == name]
            if record is None or len(known_of) == len(STEPS):
                continue
            numbers = self._steps_to_search(record.figures)
            if len(numbers) < len(STEPS):
                results.left_out.append(f"{label} with all numbers of steps")
            if len(numbers) < max(2, len(known_of) + 1):
                continue
            self._tell(label)
            try:
                found = scores_by_steps(study, name, steps, self._runs, numbers)
            except Exception as error:
                self._fail(label, error)
                continue
            kept = [one for one in kept if one["setting"] != name] + [asdict(one) for one in found]
            results.failed.pop(label, None)
        results.evaluation = kept
        self.save()

    def _steps_to_search(self, figures: Figures) -> tuple[int, ...]:
        """Numbers of steps for which time is left, by what the run's own scoring took."""
        settings = method_config(METHOD).pipeline.evaluation
        a_step = figures.get("embedding_seconds", 0.0) / settings.steps
        return steps_in(self.clock.left - START_SECONDS, a_step * self.results.subject.held_out)

    def _fail(self, name: str, error: Exception, more: str = "") -> None:
        said = str(error) if isinstance(error, DeSplatError) else f"{type(error).__name__}: {error}"
        self.results.failed[name] = f"{said}{more}"
        announce(f"{name}: {said}{more}", warning=True)
