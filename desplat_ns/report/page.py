"""The HTML page of a run: one file that needs no other and asks for none."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.files.pages import template, time_in_words
from desplat_ns.report.charts import svg
from desplat_ns.report.cost import Cost
from desplat_ns.report.effect_reasons import EffectReason
from desplat_ns.report.encoding import Encoded, Picture, fitted_into
from desplat_ns.report.history import History
from desplat_ns.report.notices import Notice
from desplat_ns.report.pictures import ERROR_COLORS, ERROR_TOP, HeldOutPhoto, TrainingPhoto

TEMPLATE = Path(__file__).with_name("page.html.jinja")

PICTURE_BYTES = 9_000_000
"""Of all pictures; text and curves fit into what is left of 10 MB."""

BESIDE = 0.6
"""Pictures that are shown at half the width get this share of the pixels' side."""

OPTION = re.compile(r"--[a-z][\w.-]*\w")
"""An option in a text."""

SCORES = {"psnr": "PSNR {:.2f} dB", "ssim": "SSIM {:.3f}", "lpips": "LPIPS {:.3f}"}


@dataclass(frozen=True)
class Contents:
    """All that is on a page."""

    cost: Cost
    notices: Sequence[Notice]
    training: Sequence[TrainingPhoto]
    num_held_out: int
    """Photos that were scored."""
    held_out: Sequence[HeldOutPhoto]
    results: Mapping[str, Any]
    """Of the evaluation; empty without one."""
    history: History
    reasons: Sequence[EffectReason]
    machine: Mapping[str, str]
    """On which the page was made."""
    config: str
    """Path of config.yml, to be typed."""


@dataclass(frozen=True)
class Sources:
    """Addresses of the pictures of one photo; None for what there is not."""

    photo: str
    rendering: str
    distractors: str | None = None
    mask: str | None = None
    error: str | None = None


def html_of(contents: Contents, budget: int = PICTURE_BYTES) -> str:
    """The page.

    Args:
        budget: bytes of all pictures together.

    Raises:
        ConfigError: there are too many pictures for it.
    """
    encoded = fitted_into(_pictures(contents), budget)
    sources = iter(encoded.sources)
    training = [
        (one, Sources(*(next(sources) for _ in range(4 if one.mask is not None else 2))))
        for one in contents.training
    ]
    held_out = [
        (one, Sources(next(sources), next(sources), error=next(sources)))
        for one in contents.held_out
    ]
    return template(TEMPLATE, scores=scores, typed=typed).render(
        page=contents,
        cost=contents.cost,
        training=training,
        held_out=held_out,
        summary=summary(contents),
        quality=quality_in_words(contents, encoded),
        charts=[(chart, svg(chart)) for chart in contents.history.charts],
        error_top=f"{ERROR_TOP:.0%}",
        error_colors=", ".join(f"rgb{color}" for color in ERROR_COLORS),
    )


def _pictures(contents: Contents) -> list[Picture]:
    """Everything to be shown, in the order in which `html_of` takes it up again."""
    pictures = []
    for one in contents.training:
        pictures += [Picture(one.photo), Picture(one.static)]
        if one.distractors is not None and one.mask is not None:
            pictures += [Picture(one.distractors, BESIDE), Picture(one.mask, BESIDE)]
    for photo in contents.held_out:
        beside = (photo.photo, photo.rendering, photo.error)
        pictures += [Picture(pixels, BESIDE) for pixels in beside]
    return pictures


def summary(contents: Contents) -> list[tuple[str, str]]:
    """The figures that stand on top, each with its name."""
    cost, results = contents.cost, contents.results
    told = []
    if "psnr" in results:
        told.append((f"{results['psnr']:.2f} dB", "PSNR of held-out photos"))
    if "ssim" in results:
        told.append((f"{results['ssim']:.3f}", "SSIM of held-out photos"))
    if "mask_iou" in results:
        told.append((f"{results['mask_iou']:.2f}", "IoU of masks with true ones"))
    told.append((f"{cost.num_photos:,}", "training photos"))
    told.append((f"{cost.steps:,}", "steps"))
    if cost.seconds is not None:
        told.append((time_in_words(cost.seconds), "of training"))
    told.append((f"{cost.num_static:,}", "static Gaussians"))
    if cost.num_distractors:
        told.append((f"{cost.num_distractors:,}", "distractor Gaussians"))
    return told


def quality_in_words(contents: Contents, encoded: Encoded) -> str:
    """What was done to the pictures to keep the page small."""
    largest = max((max(one.size) for one in contents.training), default=0)
    if largest <= encoded.side:
        reduced = "Pictures of the slider have all pixels of the photos"
    else:
        reduced = (
            f"Pictures are reduced to {encoded.side} pixels on the longer side, where the photos "
            f"have {largest:,},"
        )
    return (
        f"{reduced} and are compressed (WebP, quality {encoded.quality} of 100) so that the page "
        "stays below 10 MB; smaller ones have fewer. Scores are of the full renderings."
    )


def typed(text: str) -> str:
    """A text as HTML; options in it are set as what is typed."""
    return OPTION.sub(lambda found: f"<code>{found[0]}</code>", html.escape(text))


def scores(figures: Mapping[str, float]) -> str:
    """PSNR, SSIM and LPIPS in a line, as far as they were measured."""
    return ", ".join(form.format(figures[key]) for key, form in SCORES.items() if key in figures)
