"""The command of a study: do the runs that are missing, a few beside each other, then report."""

from __future__ import annotations

import argparse
import difflib
import fnmatch
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from desplat_ns.errors import DeSplatError
from desplat_ns.files.lock import only_process_in, only_process_writing
from desplat_ns.studies.executors import ExecutorName, executor_of
from desplat_ns.studies.runs import Figures, log_of
from desplat_ns.studies.runs import Record as Measured
from desplat_ns.studies.runs import Run as Job
from lab.arguments import parser_of
from lab.grid import records
from lab.grid.records import Record
from lab.grid.runs import Run, Study


def parse_arguments(
    program: str, description: str, output: Path, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """The options that all studies have."""
    parser = parser_of(program, description)
    parser.add_argument("--jobs", type=int, default=1, help="runs beside each other (%(default)s)")
    parser.add_argument(
        "--executor",
        choices=get_args(ExecutorName),
        default="local",
        help="where runs are done: here, or on Ray (%(default)s)",
    )
    parser.add_argument("--ray-address", help="of a cluster; without one Ray is started here")
    parser.add_argument(
        "--only",
        nargs="+",
        default=["*"],
        help="runs whose names match, or begin so: '*-clutter-2-*', '*-yard'",
    )
    parser.add_argument(
        "--list", action="store_true", help="name the runs that are to be done; then stop"
    )
    parser.add_argument("--report", action="store_true", help="only write the document")
    parser.add_argument("--output", type=Path, default=output, help="of the runs")
    return parser.parse_args(arguments)


def named_runs(study: Study, patterns: Sequence[str]) -> list[Run]:
    """The runs that match, in the order of the patterns and of the plan.

    Raises:
        DeSplatError: a pattern matches none; the message says what is named nearly so.
    """
    return list(dict.fromkeys(run for pattern in patterns for run in _runs_of(study, pattern)))


def _runs_of(study: Study, pattern: str) -> list[Run]:
    runs = [
        run
        for run in study.plan
        if fnmatch.fnmatch(run.name, pattern) or fnmatch.fnmatch(run.name, f"{pattern}-*")
    ]
    if not runs:
        names = [name for run in study.plan for name in (run.name, run.cell)]
        names = list(dict.fromkeys((*names, *study.settings, *study.scenes)))
        near = difflib.get_close_matches(pattern.strip("*-"), names, cutoff=0.0)
        raise DeSplatError(
            f"No run of the study is named '{pattern}'. Named nearly so: {', '.join(near)}. A name "
            "is setting-scene-downscale-steps-seed; take '*' for any, as in '*-yard'."
        )
    return runs


@dataclass(frozen=True)
class Command:
    """A study's command."""

    study: Study
    file: Path
    """Of its records."""
    write_report: Callable[[], Path]
    """Writes the document from the records, and says where it is."""
    output: Path
    """Folder of what is trained, unless `--output` names another."""
    program: str
    description: str
    """What `--help` says, after how the command is called."""

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Entry point; the exit status is 1 if a run failed, or if none is named so."""
        chosen = parse_arguments(self.program, self.description, self.output, arguments)
        try:
            return self._follow(chosen)
        except DeSplatError as error:
            print(f"Error: {error}", file=sys.stderr)
            return 1

    def _follow(self, chosen: argparse.Namespace) -> int:
        if chosen.list:
            for run in self._wanted(chosen.only):
                print(run.name)
            return 0
        done = [True] if chosen.report else self._do(chosen)
        print(f"written: {self.write_report()}")
        return 0 if all(done) else 1

    def _do(self, chosen: argparse.Namespace) -> list[bool]:
        """Do what is wanted; no other process may write the records or into the folder."""
        executor = executor_of(chosen.executor, chosen.jobs, chosen.ray_address)
        output, lost = chosen.output, list[bool]()
        with only_process_writing(self.file), only_process_in(output):
            runs = {run.name: run for run in self._wanted(chosen.only)}

            def coming() -> Iterator[Job]:
                for run in runs.values():
                    try:  # what is generated is made once, here
                        data = self.study.scenes[run.scene].capture.locate(output).resolve()
                    except Exception as error:
                        lost.append(self._keep(output, run, error))
                    else:
                        yield self.study.job(run, data)

            def keep(job: Job, outcome: Measured | Exception) -> bool:
                return self._keep(output, runs[job.name], outcome)

            return executor.do(coming(), output, keep) + lost

    def recorded(self, run: Run, measured: Measured) -> Record:
        """A run's record: the study's figures, and the options that were given."""

        def kept(figures: Figures, *more: str) -> Figures:
            names = (*more, *self.study.figures)
            return {name: figures[name] for name in names if name in figures}

        curve = tuple(kept(point, "step") for point in measured.curve)
        where = (measured.device, measured.backend)
        given = self.study.given_of(run)
        return Record(kept(measured.figures), measured.commit, given, *where, curve)

    def _keep(self, output: Path, run: Run, outcome: Measured | Exception) -> bool:
        """Record a run's figures and say the first; False if it failed, which is said as well."""
        if isinstance(outcome, Measured):
            try:
                records.enter(self.file, run, self.recorded(run, outcome))
            except Exception as error:  # a full disk leaves the other runs
                outcome = error
        if isinstance(outcome, Exception):
            log = f"{type(outcome).__name__}: {outcome}. Its log, as far as it came: "
            said = (
                outcome if isinstance(outcome, DeSplatError) else f"{log}{log_of(run.name, output)}"
            )
            print(f"{run.name}: {said}", file=sys.stderr, flush=True)
            return False
        first, seconds = self.study.figures[0], outcome.figures.get("train_cpu_seconds", 0.0)
        value = outcome.figures.get(first, float("nan"))
        print(f"{run.name}: {first} {value:.2f}, {seconds:.0f} s", flush=True)
        return True

    def _wanted(self, patterns: Sequence[str]) -> list[Run]:
        """The runs that match and are not done."""
        known = records.load(self.file)
        return [run for run in named_runs(self.study, patterns) if not records.is_done(run, known)]
