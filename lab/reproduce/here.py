"""Runs in this process: nothing is imported and compiled anew for each."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from nerfstudio.utils import writer

from desplat_ns.studies.executors import Keep, outcome
from desplat_ns.studies.runs import Run
from desplat_ns.studies.train_and_score import PICTURES, train_and_score


class InThisProcess:
    """An executor that starts no process; nothing keeps its runs from one another's leftovers."""

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`."""
        return [keep(run, outcome(run, folder, train_here)) for run in runs]


def train_here(line: list[object], log: Path) -> None:
    """What a process of `desplat_ns.studies.train_and_score` does, by its command line."""
    results, evaluations, method, *options = map(str, line[3:])
    writer.EVENT_WRITERS.clear()  # nerfstudio 1.1.5 keeps those of earlier runs
    writer.EVENT_STORAGE.clear()
    writer.GLOBAL_BUFFER.clear()
    with log.open("w") as file, redirect_stdout(file), redirect_stderr(file):
        record = train_and_score(method, options, log.with_name(PICTURES), int(evaluations))
    Path(results).write_text(json.dumps(record))
