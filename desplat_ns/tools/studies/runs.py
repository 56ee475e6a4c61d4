"""Runs: a method with options, trained and scored in a process of its own. Those without a record
are done and recorded."""

import json
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError, DeSplatError
from desplat_ns.tools.studies.machine import today
from desplat_ns.tools.studies.records import FILE, RUNS, Key, Record, save

QUIET = ("--experiment-name", "x", "--timestamp", "run", "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: folders of known names, no viewer, no evaluation on the way."""
PROGRAM = "desplat_ns.tools.studies.train_and_score"
RESULTS, LOG, PICTURES = "results.json", "run.log", "pictures"
"""In the folder of a run; pictures are the held-out photos with the renderings beside them."""


@dataclass(frozen=True)
class Run:
    """A method, trained on a capture for some steps with a seed, and scored."""

    variant: str
    """What runs that differ in length and seed alone have in common, in a word."""
    method: str
    """A name that nerfstudio knows."""
    options: tuple[str, ...]
    """Of `ns-train`, without length, seed and folders."""
    steps: int
    seed: int
    data: Path
    """The capture's folder."""
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
        return self.method, shlex.join(self.given), self.capture or str(self.data), self.seed


Train = Callable[[str, list[str], Path], dict[str, Any]]
"""Trains and scores a method with options, in a folder; returns as `train_and_score`."""
Do = Callable[[Run, Path], Record]
"""Does a run in a folder; see `execute`."""


def in_own_process(method: str, options: list[str], folder: Path) -> dict[str, Any]:
    """A `Train` in a process of its own. Raises DeSplatError that names its log."""
    line = [sys.executable, "-m", PROGRAM, str(folder / RESULTS), method, *options]
    piped: dict[str, Any] = {"stdin": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with (
        (folder / LOG).open("w") as log,
        subprocess.Popen(line, stdout=log, **piped) as process,
    ):
        status = process.wait()  # its stdin stays open as long as this process is there
    if status != 0:
        raise DeSplatError(f"Training or scoring failed. Its log: {folder / LOG}")
    return json.loads((folder / RESULTS).read_text())


def execute(run: Run, folder: Path, train: Train = in_own_process) -> Record:
    """Train and score a run. Its log, pictures and results stay in a folder of its name, instead of
    an earlier run's; checkpoints are removed. Raises DeSplatError where that failed."""
    if not run.data.exists():
        raise CaptureError(f"There is no {run.data}, the capture of {run.name}.")
    place = folder / run.name
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    places = ["--data", str(run.data), "--output-dir", str(place), "--machine.seed", str(run.seed)]
    began = time.monotonic()
    try:
        results = train(run.method, [*places, *QUIET, *run.given], place)
    finally:
        for checkpoints in place.glob("*/*/*/nerfstudio_models"):
            shutil.rmtree(checkpoints, ignore_errors=True)
    seconds = round(time.monotonic() - began, 1)
    figures = results["figures"]
    scores = {name: v for name, v in figures.items() if isinstance(v, int | float | str)}
    scores["versions"] = ", ".join(" ".join(pair) for pair in figures.get("versions", {}).items())
    return Record(results["commit"], today(), *run.key, scores, seconds, results["device_name"])


def finish(
    runs: Iterable[Run],
    records: dict[Key, Record],
    output: Path,
    left: Callable[[], str] = str,
    do: Do = execute,
) -> dict[str, str]:
    """Do all runs that have no record, record each as it ends, and say so; why some failed, by
    name. Raises ConfigError where records cannot be written.

    Args:
        runs: the next is asked for when the one before is done.
        records: those in the output folder; new ones are added.
        left: says after each run what is left.
    """
    failed, folder = dict[str, str](), (output / RUNS).resolve()
    for run in runs:
        if run.key in records:
            continue
        try:
            record = do(run, folder)
        except Exception as error:
            kind = "" if isinstance(error, DeSplatError) else type(error).__name__
            failed[run.name] = f"{kind}: {error}".removeprefix(": ")
            announce(f"{run.name}: {failed[run.name]}", warning=True)
            continue
        records[run.key] = record
        save(output / FILE, records.values())
        score = f"{record.scores['psnr']:.2f} dB after {record.seconds:.0f} s"
        announce(f"{run.name}: {score}. {left()}")
    return failed
