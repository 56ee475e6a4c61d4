"""The HTML page of a run: one file that needs no other and asks for none."""

import json
import shlex
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from desplat_ns.core.console import announce, list_names
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.pages import fitted_into, template
from desplat_ns.core.run_files import SURVEY, RunFiles
from desplat_ns.core.schedule import GPU_VISITS, steps_for_visits
from desplat_ns.core.whole import write_output
from desplat_ns.data.splits import in_both
from desplat_ns.data.training_views import even_subset
from desplat_ns.evaluation.config import in_words
from desplat_ns.evaluation.evaluate import gaussian_counts
from desplat_ns.tools.commands.report import Report
from desplat_ns.tools.loading import LoadedRun, load_run
from desplat_ns.tools.report import verdict
from desplat_ns.tools.report.pictures import ERROR_TOP, held_out_photos, training_photos
from desplat_ns.tools.report.views import seen_together
from desplat_ns.tools.scene.gather import scene_of
from desplat_ns.tools.scene.page import scene_html

TEMPLATE = Path(__file__).with_name("page.html.jinja")
SOURCE_BYTES = 9_000_000
"""Of scene and pictures; text, and the scene's quotes written out, fit into the rest of 10 MB."""
SCENE_BYTES = 5_500_000
"""Of the scene, with the pictures in it."""
MUCH = 0.5
"""Share of a photo. Medians over the views need places to be free in most of them."""


def write_report(files: RunFiles, output: Path, asked: Report) -> dict[str, Any]:
    """Write the page of a run, and say where; what it shows (`shown_of`). Raises DeSplatError."""
    most, run, scene = (asked.training_photos, asked.held_out_photos), load_run(files), ""
    shown = shown_of(run, *most)
    if asked.scene:
        try:
            scene, left_out = scene_html(scene_of(run, *most), SCENE_BYTES)
        except (CaptureError, ConfigError) as error:
            left_out = [f"left out. {error}"]
        for line in left_out:
            announce(f"The scene on the page: {line}", warning=True)
    content = report_html(shown, scene).encode()
    write_output(output, content)
    announce(f"Saved the page to: {output} ({len(content) / 1e6:.1f} MB)")
    return shown


def shown_of(run: LoadedRun, most_training: int, most_held_out: int) -> dict[str, Any]:
    """All that the page of a run shows, by the template's names. Raises as `held_out_photos`."""
    config, pipeline = run.config, run.pipeline
    model, manager = pipeline.model, pipeline.datamanager
    num_photos = len(manager.train_image_names)
    photos = list(training_photos(pipeline, even_subset(num_photos, most_training)))
    results, held_out = held_out_photos(pipeline, most_held_out)
    masks = [(photo.covered, photo.shown_anyway) for photo in photos if photo.covered is not None]
    alone, places = seen_together(pipeline)
    left_out = dict[str, list[str]]()
    data: Any = config.pipeline.datamanager.data
    with suppress(OSError, ValueError, LookupError, TypeError):  # not of desplat-process
        record = Path(data) / "process.json"
        left_out = json.loads(record.read_text("utf8"))["findings"]["left_out"]
    visits = config.visits * (1 if config.machine.device_type == "cpu" else GPU_VISITS)
    wanted = steps_for_visits(visits, num_photos, config.nominal_num_iterations)
    splits = [each.image_filenames for each in (manager.train_dataset, manager.eval_dataset)]
    planned, images = 0 if config.budget else config.max_num_iterations, results.get("images", [])
    said = [  # causes before consequences
        *verdict.of_the_run(run.steps, planned, wanted, num_photos, images),
        *verdict.of_the_photos(num_photos, in_both(*splits), places, left_out),
        *verdict.of_the_masks(masks),
        *verdict.of_held_out(images),
    ]
    survey, findings = run.files.folder / SURVEY, None
    with suppress(OSError, ValueError):  # a run may have none
        findings = json.loads(survey.read_text("utf8"))
    return {
        "experiment": str(config.experiment_name),
        "method": str(config.method_name),
        "capture": str(config.pipeline.datamanager.data or ""),
        "config": shlex.quote(str(run.files.config)),
        "steps": run.steps,
        "verdict": said,
        "found": verdict.found_in_words(masks),
        "num_photos": num_photos,
        "counts": gaussian_counts(model),
        "training": photos,
        "held_out": held_out,
        "results": results,  # empty where none are held out
        "distractors": None if model.distractors is None else model.distractors.config,
        "alone": alone,
        "effects": model.effects,
        "survey": findings,
        "in_the_way": model.photos_with_distractors(),
    }


def report_html(shown: Mapping[str, Any], scene: str = "") -> str:
    """The page of what `shown_of` gave, with that of the scene on top, if any; photos that are
    covered most come first. Raises ConfigError where pictures do not fit into `SOURCE_BYTES`."""
    training = sorted(shown["training"], key=lambda photo: -(photo.covered or 0.0))
    photos = [*training, *shown["held_out"]]
    of_photos = [picture for photo in photos for picture in photo.pictures.values()]
    sources = iter(fitted_into(of_photos, SOURCE_BYTES - len(scene)))
    drawn = [(photo, {name: next(sources) for name in photo.pictures}) for photo in photos]
    shares = {photo.name: photo.covered or 0.0 for photo in training}
    return template(TEMPLATE, in_words=in_words, list_names=list_names).render(
        page=shown,
        scene=scene,
        training=drawn[: len(training)],
        num_covered=sum(map(bool, shares.values())),
        hidden=[name for name, share in shares.items() if share > MUCH],
        much=f"{MUCH:.0%}",
        held_out=drawn[len(training) :],
        error_top=f"{ERROR_TOP:.0%}",
    )
