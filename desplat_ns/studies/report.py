"""The page of a study: one HTML file that needs no other, and its plots beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from desplat_ns.files.pages import (
    chart,
    inline_svg,
    plain_logarithmic,
    svg_of,
    template,
)
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.studies.machine import describe_machine
from desplat_ns.studies.plan import BASE, compared
from desplat_ns.studies.study import Study
from desplat_ns.studies.summary import (
    NEEDED,
    SIGNIFICANT,
    Measured,
    bought,
    measured,
    verdicts,
)

FILE = "report.html"
TEMPLATE = Path(__file__).with_name("report.html.jinja")

COLUMNS = {
    "psnr": ("PSNR, dB", ".2f"),
    "ssim": ("SSIM", ".3f"),
    "lpips": ("LPIPS", ".3f"),
    "mask_iou": ("mask IoU", ".3f"),
    "train_wall_seconds": ("wall, s", ".0f"),
    "train_cpu_seconds": ("CPU, s", ".0f"),
    "num_static_gaussians": ("static", ",.0f"),
    "num_distractor_gaussians": ("distractors", ",.0f"),
}
"""Scores in the table: their names there, and how they are written."""

COLOURS = ("#0b6e99", "#c4452d", "#4f8a3b", "#8b5fbf", "#d08a1d", "#2a9d8f", "#a23b72", "#6b705c")
MARKERS = "osD^vPXhd"


def write_report(study: Study) -> Path:
    """Draw the plots and write the report; where it is. Raises ConfigError where it cannot."""
    folder, points = study.request.output, measured(study.planned, study.records)
    with plain_errors(folder):
        plot = draw(folder, points) if points else ""
    base = [point for point in points if point.variant == BASE]
    columns = {
        name: column for name, column in COLUMNS.items() if any(p.values(name) for p in points)
    }
    text = template(TEMPLATE, spread=spread).render(
        capture=study.capture,
        effects=study.capture.effects.words or "none",
        study=study,
        seeds=NEEDED,
        significant=SIGNIFICANT,
        head=[title for title, _ in columns.values()],
        rows=rows_of(points, columns, study),
        within=bought(base),
        plot=inline_svg(plot) if plot else "",
        machine=describe_machine(),
    )
    with plain_errors(folder):
        write_whole(folder / FILE, text.encode())
    return folder / FILE


def rows_of(
    points: Sequence[Measured], columns: dict[str, tuple[str, str]], study: Study
) -> list[dict[str, Any]]:
    """The rows of the table in words."""
    variants, said = compared(study.capture.effects), verdicts(points)
    return [
        {
            "what": variants[point.variant].what,
            "steps": point.steps,
            "cells": [spread(point.values(name), form) for name, (_, form) in columns.items()],
            "seeds": len(point.scores),
            "verdict": said[index],
        }
        for index, point in enumerate(points)
    ]


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and the range of several values; empty where there is none."""
    if not values:
        return ""
    text = format(median(values), form)
    several = len(values) > 1
    return f"{text} ({min(values):{form}} to {max(values):{form}})" if several else text


def draw(folder: Path, points: Sequence[Measured]) -> str:
    """Draw PSNR over the training time as training.svg and training.png; the SVG. Bars reach from
    the least to the largest of the seeds."""
    with chart("training", (6.6, 4.4)) as axes:
        axes.set(xlabel="training time, s of wall time", ylabel="PSNR of right halves, dB")
        plain_logarithmic(axes.xaxis)
        for index, variant in enumerate(dict.fromkeys(point.variant for point in points)):
            mine = [point for point in points if point.variant == variant]
            (x, across), (y, along) = (_bars(mine, name) for name in ("train_wall_seconds", "psnr"))
            form = MARKERS[index % len(MARKERS)] + "-" * (variant == BASE)
            color = COLOURS[index % len(COLOURS)]
            axes.errorbar(x, y, along, across, form, color=color, label=variant, capsize=2)
        axes.legend(frameon=False, fontsize=8, ncols=2)
        text = svg_of(axes)
        (folder / "training.svg").write_text(text, "utf8")
        axes.figure.savefig(folder / "training.png", dpi=130, metadata={"Software": None})
    return text


def _bars(
    points: Sequence[Measured], name: str
) -> tuple[list[float | int], list[list[float | int]]]:
    """Medians, and how far the least and the largest are from them."""
    values = [sorted(point.values(name)) for point in points]
    middles = [median(seeds) for seeds in values]
    pairs = list(zip(middles, values, strict=True))
    return middles, [[m - seeds[0] for m, seeds in pairs], [seeds[-1] - m for m, seeds in pairs]]
