"""Gathers what is known of a run and writes its page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from desplat_ns.evaluation.records import gaussian_counts
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.model import DeSplatModel
from desplat_ns.report.cost import cost_of
from desplat_ns.report.effect_reasons import effect_reasons, read_survey
from desplat_ns.report.history import read_history
from desplat_ns.report.notices import NoticeInputs, notices
from desplat_ns.report.page import Contents, html_of
from desplat_ns.report.pictures import (
    held_out_photos,
    training_photos,
)
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.loading import LoadedRun, even_subset, load_run
from desplat_ns.separation.coverage import Coverage, failure_case


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
    chosen = even_subset(num_photos, most_training)
    pairs = list(training_photos(pipeline, chosen))
    photos = [photo for photo, _ in pairs]
    results, held_out = held_out_photos(pipeline, most_held_out)
    figures: dict[str, Any] = {"steps": run.steps, "num_photos": num_photos}
    counts = gaussian_counts(model.gauss_params, model.distractors)
    cost = cost_of(run.config, files, run.checkpoint, history, figures | counts)
    reasons = effect_reasons(model.effects, read_survey(files.survey))
    failure, by_others = separation_of(model, [coverage for _, coverage in pairs])
    inputs = NoticeInputs(cost, reasons, photos, results, failure, by_others)
    return Contents(
        cost,
        notices(inputs),
        photos,
        int(results.get("num_images", 0)),
        held_out,
        results,
        history,
        reasons,
        machine,
        str(files.config),
    )


def separation_of(model: object, coverages: Iterable[Coverage | None]) -> tuple[str | None, bool]:
    """The failure case that the photos show, if any, and whether distractors start by residuals."""
    if not isinstance(model, DeSplatModel) or model.layer is None:
        return None, False
    config, known = model.layer.config, [one for one in coverages if one is not None]
    return failure_case(config, model.means, known), config.start == "residual"


def write_report(
    files: RunFiles,
    output: Path,
    most_training: int,
    most_held_out: int,
    machine: Callable[[], Mapping[str, str]],
) -> int:
    """Write the page of a run; its size in bytes.

    Args:
        machine: describes what the page is made on.

    Raises:
        DeSplatError: the run cannot be loaded or shown, or the page cannot be written.
    """
    text = html_of(gather(load_run(files), most_training, most_held_out, machine())).encode()
    with plain_errors(output):
        write_whole(output, text)
    return len(text)
