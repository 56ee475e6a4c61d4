"""Gathers what is known of a run and writes its page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from desplat_ns.evaluation.records import gaussian_counts
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.model import DeSplatModel
from desplat_ns.report.angles import angles_of, in_words
from desplat_ns.report.cost import cost_of
from desplat_ns.report.effect_reasons import effect_reasons, read_survey
from desplat_ns.report.failure_case import failure_case
from desplat_ns.report.history import read_history
from desplat_ns.report.notices import notices
from desplat_ns.report.page import Contents, html_of
from desplat_ns.report.pictures import held_out_photos, training_photos
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.loading import LoadedRun, even_subset, load_run


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
    model = cast(DeSplatModel, pipeline.model)
    history = read_history(files.events)
    num_photos = len(pipeline.datamanager.train_image_names)
    pairs = list(training_photos(pipeline, even_subset(num_photos, most_training)))
    photos = [photo for photo, _ in pairs]
    results, held_out = held_out_photos(pipeline, most_held_out)
    angles = angles_of(pipeline)
    held_out = [angles.added_to(one) for one in held_out]
    counts = gaussian_counts(model.gauss_params, model.distractors)
    cost = cost_of(run, history.seconds, num_photos, counts)
    reasons = effect_reasons(model.effects, read_survey(files.survey))
    failure, by_others = None, False
    if model.layer is not None:
        config, coverages = model.layer.config, [one for _, one in pairs if one is not None]
        failure = failure_case(config, model.means, coverages)
        by_others = config.start == "residual"
    said = notices(cost, reasons, photos, results, failure, by_others)
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
        str(files.config),
    )


def write_report(
    files: RunFiles,
    output: Path,
    most_training: int,
    most_held_out: int,
    machine: Mapping[str, str],
) -> int:
    """Write the page of a run; its size in bytes.

    Args:
        machine: what the page is made on.

    Raises:
        DeSplatError: the run cannot be loaded or shown, or the page cannot be written.
    """
    text = html_of(gather(load_run(files), most_training, most_held_out, machine)).encode()
    with plain_errors(output):
        write_whole(output, text)
    return len(text)
