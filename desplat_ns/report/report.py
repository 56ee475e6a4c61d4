"""Gathers what is known of a run and writes its page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.report.disputed import disputed_places
from desplat_ns.report.notices import notices
from desplat_ns.report.page import Contents, html_of
from desplat_ns.report.pictures import held_out_photos, training_photos
from desplat_ns.report.recorded import (
    cost_of,
    effect_reasons,
    from_here,
    read_history,
    read_survey,
)
from desplat_ns.report.views import angles_of_held_out, seen_alone
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
    cost = cost_of(run, history.seconds)
    photos = list(training_photos(pipeline, even_subset(cost.num_photos, most_training)))
    results, held_out = held_out_photos(pipeline, most_held_out)
    angles = angles_of_held_out(pipeline) if held_out else {}
    held_out = [
        replace(photo, figures={**photo.figures, "angle": angles[photo.name]})
        if photo.name in angles
        else photo
        for photo in held_out
    ]
    survey, in_the_way = read_survey(files.survey), model.photos_with_distractors()
    reasons = effect_reasons(model.effects, survey, cost.num_photos, in_the_way)
    distractors = None if model.layer is None else model.layer.config
    disputed = disputed_places(model.means, [p.unlike for p in photos if p.unlike is not None])
    alone = seen_alone(pipeline)
    return Contents(
        cost,
        notices(cost, reasons, photos, results, distractors, disputed, alone),
        photos,
        held_out,
        results,
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
