"""Runs: a method with options, trained and scored. Those without a record are done and recorded."""

import gc
import shlex
import shutil
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.scripts.train import _set_random_seed
from nerfstudio.utils import writer

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError, DeSplatError
from desplat_ns.tools.studies.machine import code_version, device_name, today
from desplat_ns.tools.studies.methods import parse
from desplat_ns.tools.studies.records import FILE, RUNS, Key, Record, save

QUIET = ("--experiment-name", "x", "--timestamp", "run", "--vis", "tensorboard")
QUIET += ("--steps-per-eval-image", "0", "--steps-per-eval-all-images", "0")
"""Options of ns-train: folders of known names, no viewer, no evaluation on the way."""
LOG, PICTURES = "run.log", "pictures"
"""In the folder of a run; pictures are the held-out photos with the renderings beside them."""


@dataclass(frozen=True)
class Run:
    """A method, trained on a capture for some steps with a seed, and scored."""

    variant: str
    """A word that runs share which differ in length and seed alone."""
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
        return self.method, shlex.join(self.given), str(self.data), self.seed


def execute(run: Run, folder: Path) -> Record:
    """Train and score a run. Its log and pictures replace an earlier run's in a folder of its name;
    checkpoints are removed. Raises as `train_and_score`, CaptureError without the capture."""
    if not run.data.exists():
        raise CaptureError(f"There is no {run.data}, the capture of {run.name}.")
    place = folder / run.name
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    places = ["--data", str(run.data), "--output-dir", str(place), "--machine.seed", str(run.seed)]
    commit, began = code_version(), time.monotonic()
    with (place / LOG).open("w") as log, redirect_stdout(log), redirect_stderr(log):
        try:
            options = [*places, *QUIET, *run.given]
            figures, device = train_and_score(run.method, options, place / PICTURES)
        except Exception:
            traceback.print_exc()
            raise
        finally:
            gc.collect()  # a trainer refers to itself, and holds a GPU's memory
            for checkpoints in place.glob("*/*/*/nerfstudio_models"):
                shutil.rmtree(checkpoints, ignore_errors=True)
    seconds = round(time.monotonic() - began, 1)
    scores = {name: v for name, v in figures.items() if isinstance(v, int | float | str)}
    scores["versions"] = ", ".join(" ".join(pair) for pair in figures.get("versions", {}).items())
    return Record(commit, today(), *run.key, scores, seconds, device)


def train_and_score(method: str, options: list[str], pictures: Path) -> tuple[dict[str, Any], str]:
    """Train by a method and options of `ns-train`, and score: figures as of `ns-eval`, with CPU and
    wall seconds of the training steps alone, and the device's name. Raises SystemExit where
    training was stopped before its last step; such a model is not scored."""
    for kept in (writer.EVENT_WRITERS, writer.EVENT_STORAGE, writer.GLOBAL_BUFFER):
        kept.clear()  # nerfstudio 1.1.5 keeps those of earlier runs
    config = parse(method, options)
    if config.data is not None:
        config.pipeline.datamanager.data = config.data
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    wanted, seconds = config.max_num_iterations, dict[str, float]()
    _ = trainer.pipeline.datamanager.cached_train  # photos: they would be read in the first step
    wall, cpu = time.perf_counter(), time.process_time()

    def stop_the_clock(step: int) -> None:
        seconds["train_cpu_seconds"] = round(time.process_time() - cpu, 2)
        seconds["train_wall_seconds"] = round(time.perf_counter() - wall, 2)

    place = [TrainingCallbackLocation.AFTER_TRAIN_ITERATION]
    trainer.callbacks.append(TrainingCallback(place, stop_the_clock, iters=(wanted - 1,)))
    trainer.train()
    if trainer.step + 1 < wanted:  # a stop signal lets it return as if it were done
        raise SystemExit(
            f"Training stopped after {trainer.step + 1} of {wanted} steps, so that there is "
            "nothing to record. Run the study again: it begins with what is missing."
        )
    figures = trainer.pipeline.get_average_eval_image_metrics(
        step=trainer.step, output_path=pictures, get_std=True
    )
    return figures | seconds, device_name(str(trainer.device))


def finish(
    runs: Iterable[Run], records: dict[Key, Record], output: Path, left: Callable[[], str] = str
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
            record = execute(run, folder)
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
