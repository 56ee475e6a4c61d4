"""A study of a capture, run after run. Ended at any time, it goes on where it was."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.studies.executors import RUNS, Executor, open_records
from desplat_ns.studies.methods import content_of, method_config, split_of
from desplat_ns.studies.plan import (
    METHOD,
    Capture,
    Pace,
    first_run,
    fitting,
    planned,
    steps_that_fit,
)
from desplat_ns.studies.records import FILE, Key, Record
from desplat_ns.studies.runs import Run
from desplat_ns.survey.survey import decided_effects


@dataclass(frozen=True)
class Request:
    """What a user asks for."""

    data: Path
    parser: tuple[str, ...]
    """Name and options of the data parser, as `ns-train` takes them."""
    output: Path
    seconds: float
    """Of wall time, for the whole study."""
    executor: Executor


@dataclass
class Study:
    """The work on a study from one start of the command to its end."""

    request: Request
    capture: Capture
    records: dict[Key, Record]
    planned: list[Run] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    """Why a run has no record, by its name."""

    def __post_init__(self) -> None:
        earlier = sum(record.seconds for record in self.records.values())
        self._began = time.monotonic() - earlier / self.request.executor.jobs

    @property
    def spent(self) -> float:
        """Seconds of wall time. Of earlier sessions those of the runs count."""
        return time.monotonic() - self._began

    @property
    def left_out(self) -> list[str]:
        """Names of runs for which no time was left."""
        names = (run.name for run in self.planned if run.key not in self.records)
        return [name for name in names if name not in self.failed]


def open_study(request: Request) -> Study:
    """What an output folder holds of this study, or a new one.

    Raises:
        CaptureError: the capture cannot be read, or nothing of it is held out.
        ConfigError: the folder holds another study, or something else.
    """
    records, data = open_records(request.output), request.data.resolve()
    for record in records.values():
        if record.capture != str(data):
            raise ConfigError(
                f"'{request.output}' holds the study of '{record.capture}'. Name another --output, "
                "or that capture to go on with it."
            )
    return Study(request, describe_capture(data, request.parser), records)


def do_study(study: Study, tell: Callable[[str], None]) -> None:
    """Do the runs that are not done and for which time is left.

    Args:
        tell: is told what is being done.

    Raises:
        DeSplatError: the first run failed.
        ConfigError: records cannot be written.
    """
    request, capture = study.request, study.capture
    folder = (request.output / RUNS).resolve()

    def done(run: Run, record: Record) -> None:
        study.records[run.key] = record
        psnr, seconds = record.scores["psnr"], record.scores["train_wall_seconds"]
        announce(f"{run.name}: {psnr:.2f} dB after {seconds:.0f} s of training")

    def told(runs: Iterable[Run]) -> Iterator[Run]:
        for run in runs:
            tell(f"training: {run.name}")
            yield run

    def finish(runs: Iterable[Run]) -> dict[str, str]:
        return request.executor.finish(told(runs), request.output / FILE, folder, done)

    study.planned = [first_run(capture)]
    for failure in finish(study.planned).values():
        raise DeSplatError(f"The first run failed. {failure}")
    most = method_config(METHOD).nominal_num_iterations
    seconds, pace = request.seconds * request.executor.jobs, Pace(study.planned, study.records)
    steps = steps_that_fit(seconds, pace, capture, most)
    study.planned = planned(capture, steps, most)
    count = sum(run.key in study.records for run in study.planned)
    announce(
        f"Variants are compared at {steps:,} steps. Planned runs: {len(study.planned)}; done: "
        f"{count}. Of the others those are done that fit into the time."
    )
    study.failed = finish(
        fitting(study.planned, study.records, lambda: request.seconds - study.spent)
    )


def describe_capture(data: Path, parser: tuple[str, ...]) -> Capture:
    """Read a capture and survey it. Raises CaptureError, SystemExit as `split_of`."""
    if not data.exists():
        raise CaptureError(f"There is no folder {data}. Check the path to the capture.")
    train, test = (split_of(METHOD, data, parser, split) for split in ("train", "test"))
    effects, _ = decided_effects(method_config(METHOD).pipeline.model.effects, train)
    return Capture(data, parser, content_of(train, test), effects.settled())
