"""The HTML page of a run: one file that needs no other and asks for none."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.files.pages import (
    Picture,
    fitted_into,
    inline_svg,
    plain_logarithmic,
    svg_of,
    template,
)
from desplat_ns.files.pages import chart as new_chart
from desplat_ns.report.notices import Notice
from desplat_ns.report.pictures import ERROR_COLORS, ERROR_TOP, HeldOutPhoto, TrainingPhoto
from desplat_ns.report.recorded import Chart, Cost, EffectReason, History

TEMPLATE = Path(__file__).with_name("page.html.jinja")

PICTURE_BYTES = 9_000_000
"""Of all pictures; text and curves fit into what is left of 10 MB."""

BESIDE = 0.6
"""Pictures that are shown at half the width get this share of the pixels' side."""

OPTION = re.compile(r"--[a-z][\w.-]*\w")

SCORES = {
    "psnr": "PSNR {:.2f} dB",
    "ssim": "SSIM {:.3f}",
    "lpips": "LPIPS {:.3f}",
    "angle": "{:.0f}° from the photos",
}

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

    cost: Cost
    notices: Sequence[Notice]
    training: Sequence[TrainingPhoto]
    held_out: Sequence[HeldOutPhoto]
    results: Mapping[str, Any]
    """Of the evaluation; empty without one."""
    history: History
    reasons: Sequence[EffectReason]
    machine: Mapping[str, str]
    """On which the page was made."""
    config: str
    """Path of config.yml, to be typed."""


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
    encoded = fitted_into([*told, *(p for shown in pictures for p in shown.values())], budget)
    sources = iter(encoded.sources)
    noticed = [(one, next(sources) if one.picture is not None else "") for one in contents.notices]
    shown = [
        (photo, {name: next(sources) for name in names})
        for photo, names in zip(photos, pictures, strict=True)
    ]
    return template(TEMPLATE, scores=scores, typed=typed).render(
        page=contents,
        scene=scene,
        cost=contents.cost,
        training=shown[: len(training)],
        num_covered=sum(bool(photo.covered) for photo in training),
        held_out=shown[len(training) :],
        notices=noticed,
        largest=max((max(photo.size) for photo in contents.training), default=0),
        encoded=encoded,
        charts=[(chart, svg(chart)) for chart in contents.history.charts],
        error_top=f"{ERROR_TOP:.0%}",
        error_colors=", ".join(f"rgb{color}" for color in ERROR_COLORS),
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


def typed(text: str) -> str:
    """A text as HTML; options in it are set as what is typed."""
    return OPTION.sub(lambda match: f"<code>{match[0]}</code>", html.escape(text))


def scores(figures: Mapping[str, float]) -> str:
    """PSNR, SSIM, LPIPS and angle in a line, as far as they were measured."""
    return ", ".join(form.format(figures[key]) for key, form in SCORES.items() if key in figures)
