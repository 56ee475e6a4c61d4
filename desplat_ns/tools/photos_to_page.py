"""The way from photos to pages in one process; each part is made where it is missing.

OUTPUT/capture                      photos with poses, if PHOTOS has none
OUTPUT/training/NAME/METHOD/run     the trained run, by OUTPUT's name
OUTPUT/preview.html                 to look at while it trains
OUTPUT/report.html, scene.html      pages about the run, and of the scene itself
OUTPUT/scene.ply, masks/            for other programs
OUTPUT/desplat.json                 what was asked for, and what is done
"""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import torch
from nerfstudio.scripts.train import _set_random_seed

from desplat_ns.core.checkpoint import checkpoints_in
from desplat_ns.core.console import CONSOLE, Telling, about, announce, telling, time_in_words
from desplat_ns.core.cores import cores
from desplat_ns.core.errors import ConfigError, DeSplatError
from desplat_ns.core.run_files import RunFiles, find_run
from desplat_ns.core.schedule import GPU_VISITS, steps_for_visits
from desplat_ns.core.whole import begun_record, only_process_in, write_record
from desplat_ns.data.images import image_size
from desplat_ns.data.layouts import is_capture
from desplat_ns.data.photo_files import photo_names
from desplat_ns.evaluation.config import in_words
from desplat_ns.tools.commands.export import Masks, Page, Splats
from desplat_ns.tools.commands.report import Report
from desplat_ns.tools.process.request import Request
from desplat_ns.tools.report.page import write_report
from desplat_ns.tools.studies.methods import parse

RECORD = "desplat.json"
PAGES_SHARE = 0.2
"""Of a budget, for pages and files: they took 0.1 to 0.2 of the time of the training."""
LEAST_TRAINING = 30.0
"""Seconds. Start-up and survey alone take ten to twenty."""
SAID = {
    "poses": "where was each photo taken?",
    "survey": "do light and sky change from photo to photo, and how long does a step take?",
    "training": "the scene, and what was in the way. Ctrl+C stops it, and keeps what is trained.",
    "report": "report.html, a page about it.",
    "page": "scene.html, to walk around in.",
    "ply": "scene.ply, for other programs.",
    "masks": "what was in the way, photo by photo.",
}
"""The parts, and what each is."""
VIDEO_SIZE = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
FILES = {"report": "report.html", "page": "scene.html", "ply": "scene.ply", "masks": "masks"}


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
    CONSOLE.log = lambda *_, **__: None  # nerfstudio's, each with a line of its source
    with only_process_in(output):
        source = str(photos.resolve())
        done = begun_record(output / RECORD, {"photos": source})
        if done["photos"] != source:
            raise ConfigError(
                f"'{output}' holds what was made of {done['photos']}. Name another folder."
            )
        is_posed = is_capture(photos)
        capture = photos if is_posed else output / "capture"
        config = _run_folder(output, method) / "config.yml"
        config = photos if photos.name == "config.yml" else config
        missing = list(SAID)[is_capture(capture) :]
        if config == photos or method in done.setdefault("trained", {}):
            missing = [part for part in FILES if not _is_of(config, output / FILES[part], done)]
        seconds = expected_seconds(photos, method, budget) if missing else {}
        with telling({part: seconds[part] for part in missing}) as (shown, _):
            if missing:
                whole = about(sum(shown.parts.values()))
                announce(f"{', '.join(missing).capitalize()}: {whole} in all, by a rule of thumb.")
            if config != photos:
                if not is_posed:
                    if "poses" in missing:
                        shown.begin("poses", SAID["poses"])
                    Request(photos, capture).main()
                _train(capture, output, method, budget, began, done, shown)
            for line in filter(None, _pages(find_run(config), output, done, shown)):
                announce(line)
    announce(f"Done in {time_in_words(time.monotonic() - began)}.")


def expected_seconds(photos: Path, method: str, budget: float | None) -> dict[str, float]:
    """How long each part takes, roughly, of so many photos of such a size, before anything is timed
    on this machine: docs/results/speed.md."""
    settings, cuda = parse(method, []), torch.cuda.is_available()
    count, size = 100, (0.0, 0.0)
    if photos.is_dir():
        folder = photos / "images" if (photos / "images").is_dir() else photos
        names = photo_names(folder)
        count = max(1, len(names))
        with suppress(DeSplatError, IndexError):
            size = image_size(folder / names[count // 2])
    elif photos.suffix != ".yml":
        film = cv2.VideoCapture(str(photos), cv2.CAP_FFMPEG)
        frames, *size = (film.get(k) for k in (cv2.CAP_PROP_FRAME_COUNT, *VIDEO_SIZE))
        count = min(count, int(frames)) if frames >= 1 else count
    longest = max(size)
    pixels = size[0] * size[1] / 1e6 * min(1.0, 1600 / longest) ** 2 if longest > 0 else 1.0
    visits = settings.visits * (GPU_VISITS if cuda else 1)
    steps = steps_for_visits(visits, count, settings.nominal_num_iterations)
    step = 0.02 if cuda else (0.06 + 0.18 * pixels) / min(cores(), 4) ** 0.5
    poses = count * (0.3 + 1.5 * pixels) + min(count, 200) ** 2 / 2 * (0.03 + 0.1 * pixels)
    each = count * pixels
    seconds = {
        "poses": poses / cores(),
        "survey": 15 + 0.2 * count,
        "training": steps * step,
        "report": 10 + 0.5 * each,
        "page": 8 + 0.2 * each,
        "ply": 5.0,
        "masks": 5 + 0.1 * each,
    }
    if budget is not None:
        before = seconds["survey"] + (0.0 if is_capture(photos) else seconds["poses"])
        left = budget * (1 - PAGES_SHARE) - before
        seconds["training"] = max(LEAST_TRAINING, min(left, settings.nominal_num_iterations * step))
    return seconds


def _run_folder(output: Path, method: str) -> Path:
    """Of the trained run; pages have the name of the folder that it lies in as their title."""
    name = output.resolve().name.removeprefix("desplat-") or "scene"
    return output / "training" / name / method / "run"


def _train(
    capture: Path,
    output: Path,
    method: str,
    budget: float | None,
    began: float,
    done: dict[str, Any],
    shown: Telling,
) -> None:
    """Train a method on a capture to the end of its run, if it is not."""
    folder, trained = _run_folder(output, method), done["trained"]
    if method in trained:
        if budget is not None and budget > (trained[method] or budget):
            announce(f"{folder} is trained to its end. To train longer, name another OUTPUT.")
        return
    shown.begin("survey", SAID["survey"])
    options = ["--data", str(capture), "--output-dir", str(output / "training")]
    options += ["--experiment-name", folder.parents[1].name, "--timestamp", "run"]
    options += ["--vis", "tensorboard"]
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
    if checkpoints_in(folder / "nerfstudio_models"):
        options += ["--load-dir", str(folder / "nerfstudio_models")]
    config = parse(method, options)
    config.pipeline.datamanager.data = config.data
    config.print_to_terminal()
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    trainer.preview.path = output / "preview.html"
    shown.begin("training", SAID["training"])
    trainer.train()
    if not trainer.ran_to_its_end:
        announce("The same command goes on.")
        raise SystemExit(130)
    trained[method] = budget
    write_record(output / RECORD, done)


def _is_of(config: Path, made: Path, done: dict[str, Any]) -> bool:
    """Whether a page or file is of a run's newest checkpoint."""
    if done.get("pages") != str(config) or not made.exists():
        return False
    saved = checkpoints_in(find_run(config).checkpoints)
    return made.stat().st_mtime >= max(path.stat().st_mtime for path in saved)


def _pages(files: RunFiles, output: Path, done: dict[str, Any], shown: Telling) -> Iterator[str]:
    """Write the pages and files among the parts; lines on what came out, the pages last."""
    page: dict[str, Any] = {}
    writers: dict[str, Callable[[Path], None]] = {
        "report": lambda at: page.update(write_report(files, at, Report(files.config))),
        "page": lambda at: Page(files.config, output=at, overwrite=True).main(),
        "ply": lambda at: Splats(files.config, output=at, overwrite=True).main(),
        "masks": lambda at: Masks(files.config, output=at, overwrite=True).main(),
    }
    for part in [part for part in shown.parts if part in FILES]:
        shown.begin(part, SAID[part])
        try:
            writers[part](output / FILES[part])
        except ConfigError as error:  # of a run without distractors
            if part != "masks":
                raise
            announce(str(error), warning=True)
    done["pages"] = str(files.config)
    write_record(output / RECORD, done)
    if page:
        yield f"{page['steps']:,} steps on {page['num_photos']} photos."
        if page["results"]:
            yield f"Photos that were held out: {in_words(page['results'])}."
        yield page["found"]
        yield from (f"- {what} {cure}" for what, cure in page["verdict"])
    yield f"Look at it, in any browser: {(output / 'report.html').resolve().as_uri()}"
    yield f"Walk around in it:          {(output / 'scene.html').resolve().as_uri()}"
    yield f"For other programs: {output / 'scene.ply'}, {output / 'masks'}"
