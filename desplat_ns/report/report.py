"""Gathers what is known of a run and writes its page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.records import gaussian_counts
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.report.angles import angles_of, in_words
from desplat_ns.report.cost import cost_of, from_here
from desplat_ns.report.effect_reasons import effect_reasons, read_survey
from desplat_ns.report.failure_case import failure_case
from desplat_ns.report.history import read_history
from desplat_ns.report.next_photos import seen_alone
from desplat_ns.report.notices import notices
from desplat_ns.report.page import Contents, html_of
from desplat_ns.report.pictures import held_out_photos, training_photos
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.loading import LoadedRun, even_subset, load_run
from desplat_ns.scene.gather import gather as scene_contents
from desplat_ns.scene.page import html_of as scene_page

SCENE_BYTES = 14_500_000
"""Of the scene: with a report of 10 MB at most, and the quotes in it written out, the page stays
below 25 MB."""


def gather(
    run: LoadedRun, most_training: int, most_held_out: int, machine: Mapping[str, str]
) -> Contents:
    """All that the page of a run shows.

    Args:
        most_training: training photos to show.
        most_held_out: held-out photos to show; with 0 nothing is evaluated.
        machine: what the page is made on.

    Raises:
        CaptureError: a photo that cannot be read any more.
        DeSplatError: a figure of a held-out photo is not a finite number.
    """
    pipeline, files = run.pipeline, run.files
    model = pipeline.model
    history = read_history(files.events)
    num_photos = len(pipeline.datamanager.train_image_names)
    pairs = list(training_photos(pipeline, even_subset(num_photos, most_training)))
    photos = [photo for photo, _ in pairs]
    results, held_out = held_out_photos(pipeline, most_held_out)
    angles = angles_of(pipeline)
    held_out = [angles.added_to(photo) for photo in held_out]
    counts = gaussian_counts(model.gauss_params, model.distractors)
    cost = cost_of(run, history.seconds, num_photos, counts)
    in_the_way = model.photos_with_distractors()
    reasons = effect_reasons(model.effects, read_survey(files.survey), num_photos, in_the_way)
    failure, by_others = None, False
    if model.layer is not None:
        config = model.layer.config
        coverages = [coverage for _, coverage in pairs if coverage is not None]
        failure = failure_case(config, model.means, coverages)
        by_others = config.start == "residual"
    alone = seen_alone(pipeline)
    said = notices(cost, reasons, photos, results, failure, by_others, alone)
    return Contents(
        cost,
        said,
        photos,
        held_out,
        results,
        in_words(angles),
        history,
        reasons,
        machine,
        from_here(files.config),
    )


def scene_of(run: LoadedRun, most_training: int, most_held_out: int) -> str:
    """The page of the scene itself; empty, and said why, where there is none to show."""
    try:
        contents = scene_contents(run, most_training, most_held_out)
        text, left_out = scene_page(contents, SCENE_BYTES)
    except (CaptureError, ConfigError) as error:
        announce(f"The report is without the scene itself. {error}", warning=True)
        return ""
    for line in left_out:
        announce(f"The scene on the page: {line}", warning=True)
    return text


def write_report(
    files: RunFiles,
    output: Path,
    most_training: int,
    most_held_out: int,
    machine: Mapping[str, str],
    with_scene: bool,
) -> int:
    """Write the page of a run; its size in bytes.

    Args:
        machine: what the page is made on.
        with_scene: whether the scene itself is on top.

    Raises:
        DeSplatError: the run cannot be loaded or shown, or the page cannot be written.
    """
    run = load_run(files)
    contents = gather(run, most_training, most_held_out, machine)
    scene = scene_of(run, most_training, most_held_out) if with_scene else ""
    text = html_of(contents, scene=scene).encode()
    with plain_errors(output):
        write_whole(output, text)
    return len(text)
