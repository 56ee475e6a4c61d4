"""`desplat-tradeoff`: what accuracy costs in time on a capture, measured on this machine."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from desplat_ns.commands.parser_words import parse
from desplat_ns.console import announce, progress_in_time
from desplat_ns.cores import cores
from desplat_ns.errors import CaptureError, print_user_errors_plainly
from desplat_ns.files.lock import only_process_in
from desplat_ns.settings.options import check_ranges, ranged
from desplat_ns.studies.executors import Executor, ExecutorName
from desplat_ns.training.schedule import seconds_of

if TYPE_CHECKING:  # seconds: not before the options are checked
    from desplat_ns.studies.study import Request

MOST_JOBS = 8
"""Trainings beside each other, unless more are asked for."""


@dataclass
class Arguments:
    """Measure what accuracy costs in time: lengths, sizes of photos, effects.

    A data parser's name and its options, as `ns-train` takes them, may follow; without them the
    capture's layout is recognised, as there. `desplat-tradeoff DATA colmap --help` lists the
    options of colmap.
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    time: str = "30min"
    """Wall time for the whole study, earlier sessions included."""
    output: Path = Path("tradeoff")
    """Folder for the report, its plot, records.jsonl and what is trained. What is there already is
    gone on with."""
    jobs: int = ranged(0, "[0, inf)")
    """Trainings beside each other, one thread each; 0: one on a GPU, else one for each core, eight
    at most."""
    executor: ExecutorName = "local"
    """Where trainings are done: here, or on Ray."""
    ray_address: str | None = None
    """Of a cluster; without one Ray is started here."""

    def request(self, parser: tuple[str, ...]) -> Request:
        """What is to be studied.

        Raises:
            CaptureError: no capture is found.
            ConfigError: an option cannot be.
        """
        check_ranges(self)
        seconds = seconds_of(self.time, "--time")
        if not self.data.exists():
            raise CaptureError(f"There is no '{self.data}'. Name the folder of a capture.")

        from desplat_ns.studies.methods import method_config
        from desplat_ns.studies.plan import METHOD
        from desplat_ns.studies.study import Request

        parser = parser or recognised_words(self.data)
        jobs = self.jobs or default_jobs(method_config(METHOD).machine.device_type)
        executor = Executor(self.executor, jobs, self.ray_address)
        return Request(self.data, parser, self.output, seconds, executor)


def recognised_words(data: Path) -> tuple[str, ...]:
    """The data parser, and its options, that ns-train takes for a capture; says which and why.

    Raises:
        CaptureError: no capture is found.
    """
    from desplat_ns.layouts.recognition import recognise

    recognition = recognise(data)
    announce(recognition.line())
    return recognition.match.words


def default_jobs(device: str) -> int:
    """Trainings beside each other: a GPU is shared badly, and times beside others mean little."""
    return min(cores(), MOST_JOBS) if device == "cpu" else 1


def study(request: Request) -> Path:
    """Do a study as far as its time goes and write its report; where that is.

    Raises:
        DeSplatError: the capture or the folder will not do, the first run failed, or another
            process is at work in the folder.
    """
    from desplat_ns.backend.registry import compile_kernels, default_device
    from desplat_ns.studies.report import write_report
    from desplat_ns.studies.study import do_study, open_study

    with only_process_in(request.output):
        compile_kernels("auto", default_device())  # no part of the time that was given
        work = open_study(request)
        with progress_in_time(request.seconds, lambda: work.spent) as tell:
            do_study(work, tell)
        return write_report(work)


def main() -> None:
    """Entry point of the command."""
    print_user_errors_plainly()
    arguments, parser = parse(Arguments, "desplat-tradeoff", sys.argv[1:])
    report = study(arguments.request(parser))
    announce(f"Written: {report}")


if __name__ == "__main__":
    main()
