"""The HTML page of a run: one file that needs no other and asks for none."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.config import in_words
from desplat_ns.files.pages import (
    Picture,
    fitted_into,
    inline_svg,
    plain_logarithmic,
    svg_of,
    template,
)
from desplat_ns.files.pages import chart as new_chart
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.report.notices import Notice, notices
from desplat_ns.report.pictures import (
    ERROR_TOP,
    HeldOutPhoto,
    TrainingPhoto,
    held_out_photos,
    training_photos,
)
from desplat_ns.report.recorded import (
    Chart,
    EffectReason,
    Numbers,
    effect_reasons,
    numbers_of,
    read_history,
    read_survey,
)
from desplat_ns.report.views import disputed_places, seen_alone
from desplat_ns.runs.files import SURVEY, RunFiles
from desplat_ns.runs.loading import LoadedRun, even_subset, load_run
from desplat_ns.scene.gather import gather as scene_contents
from desplat_ns.scene.page import html_of as scene_page

TEMPLATE = Path(__file__).with_name("page.html.jinja")

PICTURE_BYTES = 9_000_000
"""Of all pictures; text and curves fit into what is left of 10 MB."""

SCENE_BYTES = 14_500_000
"""Of the scene: with a report of 10 MB at most, and the quotes in it written out, the page stays
below 25 MB."""

BESIDE = 0.6
"""Pictures that are shown at half the width get this share of the pixels' side."""

CHART_SIZE = (4.8, 2.8)
"""Inches, where letters have 10 points."""

COLOURS = {"#0b6e99": "var(--accent)", "#c2571a": "var(--second)", "#000000": "var(--soft)"}
"""Of the first curve, the second, and the axes: as drawn, and as the page calls them, light or
dark."""

FEW = 12
"""Points of a curve, up to which each has a mark."""


@dataclass(frozen=True)
class Contents:
    """All that is on a page."""

    numbers: Numbers
    notices: Sequence[Notice]
    training: Sequence[TrainingPhoto]
    held_out: Sequence[HeldOutPhoto]
    results: Mapping[str, Any]
    """Of the evaluation; empty without one."""
    charts: Sequence[Chart]
    reasons: Sequence[EffectReason]
    config: str
    """Path of config.yml, as a shell takes it."""


def write_report(
    files: RunFiles, output: Path, most_training: int, most_held_out: int, with_scene: bool
) -> None:
    """Write the page of a run, and say where; arguments as of the command. Raises DeSplatError."""
    run, scene = load_run(files), ""
    contents = gather(run, most_training, most_held_out)
    if with_scene:
        try:
            shown = scene_contents(run, most_training, most_held_out)
            scene, left_out = scene_page(shown, SCENE_BYTES)
        except (CaptureError, ConfigError) as error:
            left_out = [f"left out. {error}"]
        for line in left_out:
            announce(f"The scene on the page: {line}", warning=True)
    content = html_of(contents, scene=scene).encode()
    with plain_errors(output):
        write_whole(output, content)
    announce(f"Saved the page to: {output} ({len(content) / 1e6:.1f} MB)")


def gather(run: LoadedRun, most_training: int, most_held_out: int) -> Contents:
    """All that the page of a run shows. Raises as `training_photos` and `held_out_photos`."""
    pipeline, files = run.pipeline, run.files
    model = pipeline.model
    charts, seconds = read_history(sorted(files.folder.glob("events.out.tfevents.*")))
    numbers = numbers_of(run, seconds)
    photos = list(training_photos(pipeline, even_subset(numbers.num_photos, most_training)))
    results, held_out = held_out_photos(pipeline, most_held_out)
    survey, in_the_way = read_survey(files.folder / SURVEY), model.photos_with_distractors()
    reasons = effect_reasons(model.effects, survey, numbers.num_photos, in_the_way)
    distractors = None if model.layer is None else model.layer.config
    disputed = disputed_places(model.means, [p.unlike for p in photos if p.unlike is not None])
    said = notices(numbers, photos, distractors, disputed, seen_alone(pipeline))
    config = shlex.quote(str(files.config))
    return Contents(numbers, said, photos, held_out, results, charts, reasons, config)


def html_of(contents: Contents, budget: int = PICTURE_BYTES, scene: str = "") -> str:
    """The page. Of training photos those that distractors cover most come first.

    Args:
        budget: bytes of all pictures together.
        scene: the page of the scene itself, to be framed on top; empty for none.

    Raises:
        ConfigError: there are too many pictures for it.
    """
    training = sorted(contents.training, key=lambda photo: -(photo.covered or 0.0))
    photos = [*training, *contents.held_out]
    pictures = [_pictures(photo) for photo in photos]
    told = [Picture(one.picture, BESIDE) for one in contents.notices if one.picture is not None]
    sources = iter(fitted_into([*told, *(p for one in pictures for p in one.values())], budget))
    noticed = [(one, next(sources) if one.picture is not None else "") for one in contents.notices]
    shown = [
        (photo, {name: next(sources) for name in names})
        for photo, names in zip(photos, pictures, strict=True)
    ]
    return template(TEMPLATE, in_words=in_words).render(
        page=contents,
        scene=scene,
        numbers=contents.numbers,
        training=shown[: len(training)],
        num_covered=sum(bool(photo.covered) for photo in training),
        held_out=shown[len(training) :],
        notices=noticed,
        charts=[(chart, svg(chart)) for chart in contents.charts],
        error_top=f"{ERROR_TOP:.0%}",
    )


def _pictures(photo: TrainingPhoto | HeldOutPhoto) -> dict[str, Picture]:
    """What is shown of a photo, by the template's names."""
    if isinstance(photo, HeldOutPhoto):
        beside = {"photo": photo.photo, "rendering": photo.rendering, "error": photo.error}
        return {name: Picture(pixels, BESIDE) for name, pixels in beside.items()}
    shown = {"photo": Picture(photo.photo), "rendering": Picture(photo.static)}
    if photo.distractors is not None and photo.mask is not None:
        shown |= {"distractors": Picture(photo.distractors, BESIDE)}
        shown |= {"mask": Picture(photo.mask, BESIDE)}
    return shown


def svg(chart: Chart) -> str:
    """A chart over the steps; the names of its curves are the page's to write."""
    with new_chart(chart.title, CHART_SIZE) as axes:
        if chart.is_logarithmic:
            plain_logarithmic(axes.yaxis)
        else:
            axes.yaxis.set_major_formatter("{x:,.10g}")
        axes.xaxis.set_major_formatter("{x:,.10g}")
        for points, colour in zip(chart.curves.values(), COLOURS, strict=False):
            steps, values = zip(*points, strict=True)
            mark = "o" if len(points) <= FEW else ""
            axes.plot(steps, values, color=colour, marker=mark, markersize=4)
        axes.locator_params(axis="x", nbins=5)
        axes.figure.set_facecolor("none")
        axes.set_facecolor("none")
        drawn = inline_svg(svg_of(axes))
    drawn = re.sub(r' clip-path="[^"]*"', "", drawn)  # all curves lie within the axes
    return re.sub("|".join(COLOURS), lambda match: COLOURS[match[0]], drawn)
