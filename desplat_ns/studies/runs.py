"""What is run: a variant of a method, trained and scored in a process of its own, on one thread."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.errors import CaptureError, DeSplatError

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
"""So that runs beside each other disturb each other little: waiting threads sleep."""

EXPERIMENT, TIMESTAMP = "x", "run"
"""Folders in which nerfstudio puts a run, so that it is found again."""

QUIET = ("--experiment-name", EXPERIMENT, "--timestamp", TIMESTAMP, "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: no viewer, no evaluation on the way."""


def surroundings(**variables: str) -> dict[str, str]:
    """The environment of a process that a study starts.

    It imports what this process would, from a checkout as from an installed package.
    """
    paths = os.pathsep.join(dict.fromkeys(os.path.abspath(place) for place in sys.path))
    return os.environ | {"PYTHONPATH": paths} | variables


def run_command(line: list[object], log: Path, **environment: str) -> None:
    """Run one of the environment's commands.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    program, *arguments = map(str, line)
    command = [str(Path(sys.executable).with_name(program)), *arguments]
    with log.open("w") as file:
        done = subprocess.run(
            command,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=surroundings(**(ONE_THREAD | environment)),
        )
    if done.returncode != 0:
        raise DeSplatError(f"`{program}` failed. Its log: {log}")


PROGRAM = "desplat_ns.studies.train_and_score"
RESULTS = "results.json"
"""What the program writes, in the run's folder."""

Figures = Mapping[str, int | float]
"""What was measured, by the names of the evaluation."""


@dataclass(frozen=True)
class Variant:
    """A method with options."""

    name: str
    what: str = ""
    """In what it differs from others, in words."""
    options: tuple[str, ...] = ()
    """Of `ns-train`."""
    method: str = "desplat"
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""


@dataclass(frozen=True)
class Run:
    """A variant, trained on a capture for some steps with a seed, and scored."""

    variant: Variant
    steps: int
    seed: int
    data: Path
    """The capture's folder: in the same place on every machine that trains."""
    parser: tuple[str, ...] = ()
    """The data parser's name and options; empty for the method's own."""
    evaluations: int = 1
    """How often it is scored: in the end, after half of its steps, after a quarter, and so on; with
    more than one its record has a curve."""

    @property
    def name(self) -> str:
        """Of its record and its folder."""
        return f"{self.variant.name}-{self.steps}-{self.seed}"

    @property
    def options(self) -> tuple[str, ...]:
        """Of `ns-train`, all but the seed and the places."""
        length = ("--max-num-iterations", str(self.steps))
        return (*length, *QUIET, *self.variant.options, *self.parser)


@dataclass(frozen=True)
class Record:
    """A run that was measured."""

    figures: Figures
    """Those of the evaluation, with `run_wall_seconds`, those of the process from start to end."""
    commit: str
    """Of the code, as `code_version` gives it."""
    device: str | None = None
    """Its type, `cpu` or `cuda`."""
    backend: str | None = None
    """The rasterizer that was used, whatever chose it."""
    curve: tuple[Figures, ...] = ()
    """The figures on the way and in the end, each with its `step`; empty if it was scored once."""

    @classmethod
    def from_json(cls, row: Any) -> Record:
        """What `asdict` gave, once it was written as JSON."""
        return cls(**row | {"curve": tuple(row["curve"])})


Command = Callable[[list[object], Path], None]
"""Does a line of a program and its arguments, and writes what it says to a log; see `run_command`.
"""


def execute(run: Run, folder: Path, command: Command | None = None) -> Record:
    """The record of a run; what it trains stays in a folder of its name.

    An earlier one of that name is replaced once this one is whole.

    Args:
        command: what does the work; `run_command` unless another is given.

    Raises:
        DeSplatError: the capture is not there; or training or evaluation failed, and the message
            names its log.
    """
    if not run.data.exists():
        raise CaptureError(
            f"There is no capture at {run.data}. Every machine that trains for a study needs the "
            "photos in the same place."
        )
    log = log_of(run.name, folder)
    draft, results = log.parent, log.with_name(RESULTS)
    shutil.rmtree(draft, ignore_errors=True)  # of a run that failed, if it is there
    draft.mkdir(parents=True)
    places = ["--data", run.data, "--output-dir", draft, "--machine.seed", run.seed]
    line = ["python", "-m", PROGRAM, results, run.evaluations, run.variant.method, *places]
    began = time.monotonic()
    (command or run_command)([*line, *run.options], log)
    record = _read(results, time.monotonic() - began)
    _settle(draft, folder / run.name)
    return record


def log_of(name: str, folder: Path) -> Path:
    """Where the run of a name that is being done, or that failed, says what happens."""
    return folder / f"{name}.draft" / "run.log"


def remove_checkpoints(name: str, folder: Path) -> None:
    """Of the run of a name that is done, or that failed: it is begun anew then."""
    for home in (folder / name, log_of(name, folder).parent):
        for models in home.glob("*/*/*/nerfstudio_models"):
            shutil.rmtree(models, ignore_errors=True)


def _settle(draft: Path, output: Path) -> None:
    """Put a finished run where it is looked for; its config.yml says so, too."""
    for config in draft.glob(f"{EXPERIMENT}/*/{TIMESTAMP}/config.yml"):
        text = config.read_text()  # nerfstudio writes a path as a list of its parts
        config.write_text(text.replace(f"- {draft.name}\n", f"- {output.name}\n"))
    shutil.rmtree(output, ignore_errors=True)
    draft.rename(output)


def _read(path: Path, seconds: float) -> Record:
    """What `train_and_score` wrote: of its figures those that are numbers."""
    results: dict[str, Any] = json.loads(path.read_text())

    def numbers(figures: Mapping[str, Any]) -> Figures:
        return {name: value for name, value in figures.items() if isinstance(value, int | float)}

    figures = {**numbers(results["figures"]), "run_wall_seconds": round(seconds, 1)}
    curve = tuple(map(numbers, results["curve"]))
    return Record(figures, results["commit"], results["device"], results["backend"], curve)
