"""The way from photos to pages in one process; each part is made where it is missing.

OUTPUT/capture                      photos with poses, if PHOTOS has none
OUTPUT/training/METHOD/run          the trained run
OUTPUT/preview.html                 to look at while it trains
OUTPUT/report.html, scene.html      pages about the run, and of the scene itself
OUTPUT/scene.ply, masks/            for other programs
OUTPUT/desplat.json                 what was asked for, and what is done
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.scripts.train import _set_random_seed

from desplat_ns.core.checkpoint import checkpoints_in
from desplat_ns.core.console import PART, about, announce, time_in_words
from desplat_ns.core.errors import ConfigError
from desplat_ns.core.run_files import RunFiles, find_run
from desplat_ns.core.whole import only_process_in, write_whole
from desplat_ns.data.layouts import is_capture
from desplat_ns.evaluation.config import in_words
from desplat_ns.tools.commands.export import Masks, Page, Splats
from desplat_ns.tools.commands.report import Report
from desplat_ns.tools.preview import Preview
from desplat_ns.tools.process.request import Request
from desplat_ns.tools.report.page import write_report
from desplat_ns.tools.studies.methods import parse

RECORD = "desplat.json"
PAGES_SHARE = 0.2
"""Of a budget, or of the time of the training, for pages and files: they took 0.1 to 0.2 of it."""
LEAST_TRAINING = 30.0
"""Seconds. Start-up and survey alone take ten to twenty."""


def make(photos: Path, output: Path, method: str, budget: float | None) -> None:
    """Make what is missing in `output`, and say what came out.

    Args:
        photos: a folder of photos, a video, a capture, or a run's config.yml.
        budget: seconds of all parts together; None for as many steps as the photos ask for.

    Raises:
        ConfigError: `output` holds something else, or the output of other photos.
        DeSplatError: as of the parts; what is done is kept.
        SystemExit: training was stopped.
    """
    began = time.monotonic()
    with only_process_in(output), _record(output, photos) as done:
        if photos.name == "config.yml":
            files = find_run(photos)
        else:
            capture = photos if is_capture(photos) else _posed(photos, output / "capture")
            files = _trained(capture, output, method, budget, began, done)
        for line in _pages(files, output, done):
            announce(line)
    announce(f"Done in {time_in_words(time.monotonic() - began)}.")


@contextmanager
def _record(output: Path, photos: Path) -> Iterator[dict[str, Any]]:
    """What is done in `output`, kept in `RECORD` as it changes. Raises ConfigError where the folder
    holds something else, or the output of other photos."""
    path, source = output / RECORD, str(photos.resolve())
    if path.is_file():
        try:
            done = json.loads(path.read_text("utf8"))
            made_of = done["photos"]
        except (ValueError, LookupError, TypeError) as error:
            raise ConfigError(f"{path} is damaged ({error}). Name another folder.") from error
        if made_of != source:
            raise ConfigError(f"'{output}' holds what was made of {made_of}. Name another folder.")
    elif others := [at.name for at in output.iterdir() if not at.name.endswith(".in-use")]:
        raise ConfigError(
            f"'{output}' holds something else ({others[0]}). Name a new or an empty folder."
        )
    else:
        done = {"photos": source}
    try:
        yield done
    finally:
        PART.set("")
        write_whole(path, json.dumps(done, indent=1).encode())


def _begin_part(number: int, what: str) -> None:
    PART.set(f"Part {number} of 3: ")
    announce(PART.get() + what)


def _posed(photos: Path, capture: Path) -> Path:
    _begin_part(1, "where was each photo taken?")
    Request(photos, capture).main()
    return capture


def _trained(
    capture: Path,
    output: Path,
    method: str,
    budget: float | None,
    began: float,
    done: dict[str, Any],
) -> RunFiles:
    """The run of a method on a capture, trained to its end."""
    folder = output / "training" / method / "run"
    trained, saved = done.setdefault("trained", {}), folder / "nerfstudio_models"
    if method in trained:
        if budget is not None and budget > (trained[method] or budget):
            announce(f"{folder} is trained to its end. To train longer, name another OUTPUT.")
        return find_run(folder / "config.yml")
    _begin_part(2, "training. Ctrl+C stops it, and keeps what is trained.")
    options = ["--data", str(capture), "--output-dir", str(output), "--vis", "tensorboard"]
    options += ["--experiment-name", "training", "--timestamp", "run"]
    if budget is not None:
        spent = time.monotonic() - began
        left = budget * (1 - PAGES_SHARE) - spent
        if left < LEAST_TRAINING:
            raise ConfigError(
                f"Of a --budget of {time_in_words(budget)}, {time_in_words(spent)} are spent, and "
                f"{PAGES_SHARE:.0%} are for the pages: training has {time_in_words(max(0, left))}. "
                "What is done is kept: type the command again, or give it a larger --budget."
            )
        options += ["--budget", f"{left:.0f}s"]
    if checkpoints_in(saved):
        options += ["--load-dir", str(saved)]
    config, began = parse(method, options), time.monotonic()
    config.pipeline.datamanager.data = config.data
    config.print_to_terminal()
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    preview = Preview(output / "preview.html", trainer)
    after_step = [TrainingCallbackLocation.AFTER_TRAIN_ITERATION]
    trainer.callbacks.append(TrainingCallback(after_step, preview.after_step))
    announce(f"To look at meanwhile: {preview.path.resolve().as_uri()}")
    trainer.train()
    if not trainer.ran_to_its_end:
        announce("The same command goes on.")
        raise SystemExit(130)
    trained[method], done["seconds"] = budget, round(time.monotonic() - began)
    return find_run(folder / "config.yml")


def _pages(files: RunFiles, output: Path, done: dict[str, Any]) -> Iterator[str]:
    """Write pages and files that are not newer than the run's checkpoint; lines on what came out,
    the most important last."""
    seconds = f", {about(PAGES_SHARE * done['seconds'])} at most" if "seconds" in done else ""
    _begin_part(3, f"pages and files{seconds}.")
    trained = max(path.stat().st_mtime for path in checkpoints_in(files.checkpoints))
    shown: dict[str, Any] = {}
    writers: dict[str, Callable[[Path], None]] = {
        "report.html": lambda at: shown.update(write_report(files, at, Report(files.config))),
        "scene.html": lambda at: Page(files.config, output=at, overwrite=True).main(),
        "scene.ply": lambda at: Splats(files.config, output=at, overwrite=True).main(),
        "masks": lambda at: Masks(files.config, output=at, overwrite=True).main(),
    }
    for name, write in writers.items():
        at = output / name
        is_of_this_run = done.get("pages") == str(files.config)
        if is_of_this_run and at.exists() and at.stat().st_mtime >= trained:
            continue
        try:
            write(at)
        except ConfigError as error:  # of a run without distractors
            if name != "masks":
                raise
            announce(str(error), warning=True)
    done["pages"] = str(files.config)
    if shown:
        yield f"{shown['steps']:,} steps on {shown['num_photos']} photos."
        if shown["results"]:
            yield f"Photos that were held out: {in_words(shown['results'])}."
        yield from (f"- {what} {cure}" for what, cure in shown["verdict"])
    yield f"Look at it, in any browser: {(output / 'report.html').resolve().as_uri()}"
    yield f"Walk around in it:          {(output / 'scene.html').resolve().as_uri()}"
    yield f"For other programs: {output / 'scene.ply'}, {output / 'masks'}"
