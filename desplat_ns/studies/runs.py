"""One run: a method with options, trained and scored in a process of its own, on one thread."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.errors import CaptureError, DeSplatError
from desplat_ns.studies.machine import today
from desplat_ns.studies.records import Key, Record

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
"""So that runs beside each other disturb each other little: waiting threads sleep."""

EXPERIMENT, TIMESTAMP = "x", "run"
"""Folders in which nerfstudio puts a run, so that it is found again."""

QUIET = ("--experiment-name", EXPERIMENT, "--timestamp", TIMESTAMP, "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: no viewer, no evaluation on the way."""

PROGRAM = "desplat_ns.studies.train_and_score"
RESULTS = "results.json"
"""What the program writes, in the run's folder."""
PICTURES = "pictures"
"""Folder beside the results, with the held-out photos and the renderings beside them."""


@dataclass(frozen=True)
class Run:
    """A method, trained on a capture for some steps with a seed, and scored."""

    variant: str
    """What runs that differ in length and seed alone have in common, in a word."""
    method: str
    """A name that nerfstudio knows, or `module:attribute` of a MethodSpecification."""
    options: tuple[str, ...]
    """Of `ns-train`, without length, seed and folders."""
    steps: int
    seed: int
    data: Path
    """The capture's folder: in the same place on every machine that trains."""
    parser: tuple[str, ...] = ()
    """The data parser's name and options; empty for the method's own."""
    capture: str = ""
    """What its record calls the capture; by default the path of the folder."""

    @property
    def name(self) -> str:
        """Of its folder, and in messages."""
        return f"{self.variant}-{self.steps}-{self.seed}"

    @property
    def given(self) -> tuple[str, ...]:
        """The options that its record names."""
        return ("--max-num-iterations", str(self.steps), *self.options, *self.parser)

    @property
    def key(self) -> Key:
        """That of its record."""
        return self.method, shlex.join(self.given), self.capture or str(self.data), self.seed


Command = Callable[[list[str], Path], None]
"""Does a line of a program and its arguments, and writes what it says to a log."""


def surroundings(**variables: str) -> dict[str, str]:
    """The environment of a process that a study starts.

    It imports what this process would, from a checkout as from an installed package.
    """
    paths = os.pathsep.join(dict.fromkeys(os.path.abspath(place) for place in sys.path))
    return os.environ | {"PYTHONPATH": paths} | variables


def run_command(line: list[str], log: Path) -> None:
    """Run one of the environment's commands on one thread.

    Raises:
        DeSplatError: it failed; the message names its log.
    """
    command = [str(Path(sys.executable).with_name(line[0])), *line[1:]]
    environment = surroundings(**ONE_THREAD)
    with log.open("w") as file:
        done = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT, env=environment)
    if done.returncode != 0:
        raise DeSplatError(f"`{line[0]}` failed. Its log: {log}")


def execute(run: Run, folder: Path, command: Command = run_command) -> Record:
    """Train and score a run. Its log, pictures and RESULTS stay in a folder of its name.

    An earlier run of that name is replaced once this one is whole. Checkpoints are removed.

    Raises:
        DeSplatError: the capture is not there; or training or evaluation failed, and the message
            names its log.
    """
    if not run.data.exists():
        raise CaptureError(
            f"There is no capture at {run.data}. Every machine that trains for a study needs the "
            "photos in the same place."
        )
    draft = folder / f"{run.name}.draft"
    shutil.rmtree(draft, ignore_errors=True)  # of a run that failed, if it is there
    draft.mkdir(parents=True)
    places = ["--data", str(run.data), "--output-dir", str(draft), "--machine.seed", str(run.seed)]
    line = ["python", "-m", PROGRAM, str(draft / RESULTS), "1", run.method, *places]
    length, parser = run.given[:2], run.parser
    began = time.monotonic()
    try:
        command([*line, *length, *QUIET, *run.options, *parser], draft / "run.log")
    finally:
        for checkpoints in draft.glob("*/*/*/nerfstudio_models"):
            shutil.rmtree(checkpoints, ignore_errors=True)
    results: dict[str, Any] = json.loads((draft / RESULTS).read_text())
    seconds = round(time.monotonic() - began, 1)
    shutil.rmtree(folder / run.name, ignore_errors=True)
    draft.rename(folder / run.name)
    figures = results["figures"]
    scores = {
        name: value for name, value in figures.items() if isinstance(value, int | float | str)
    }
    scores["versions"] = ", ".join(" ".join(pair) for pair in figures.get("versions", {}).items())
    return Record(results["commit"], today(), *run.key, scores, seconds, results["device_name"])
