"""The page of a study: medians over seeds with their ranges, and a plot."""

import base64
import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure

from desplat_ns.core.pages import template
from desplat_ns.core.whole import write_output
from desplat_ns.tools.studies.records import conditions_of
from desplat_ns.tools.studies.tradeoff import BASE, Study, compared

TEMPLATE = Path(__file__).with_name("page.html.jinja")
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
MARKERS = "osD^vPXhd"
Scores = Mapping[int, Mapping[str, Any]]
"""By seed."""
Point = tuple[str, int]
"""A variant and a length."""


def measured(study: Study) -> dict[Point, Scores]:
    """What has a record of at least one seed, the shortest first."""
    points: dict[Point, dict[int, Mapping[str, Any]]] = {}
    for run in sorted(study.planned, key=lambda run: run.steps):
        if (record := study.records.get(run.key)) is not None:
            points.setdefault((run.variant, run.steps), {})[run.seed] = record.scores
    return dict(points)


def values(scores: Scores, name: str) -> list[float | int]:
    """A score of each seed that has it."""
    return [row[name] for row in scores.values() if name in row]


def gain(points: Mapping[Point, Scores], point: Point) -> str:
    """PSNR of a point less the base's at as many steps, seed by seed, by `spread`; empty where
    there is nothing to compare it with."""
    variant, steps = point
    base = {} if variant == BASE else points.get((BASE, steps), {})
    scores = points[point]
    return spread([scores[s]["psnr"] - base[s]["psnr"] for s in scores if s in base], "+.2f")


def write_page(study: Study) -> Path:
    """Write the page; where it is. Raises ConfigError where it cannot."""
    page, points = study.output / "report.html", measured(study)
    text = template(TEMPLATE, spread=spread, values=values).render(
        study=study,
        columns=COLUMNS,
        variants=compared(study.effects),
        points=points,
        gains={point: gain(points, point) for point in points},
        plot=drawn(points),
        conditions=conditions_of(study.records.values()),
    )
    write_output(page, text.encode())
    return page


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and the range of several values; empty where there is none."""
    if not values:
        return ""
    text = f"{median(values):{form}}"
    return f"{text} ({min(values):{form}} to {max(values):{form}})" if len(values) > 1 else text


def drawn(points: Mapping[Point, Scores]) -> str:
    """PSNR over the training time, a mark for each training, as the address of a PNG."""
    figure = Figure(figsize=(6.6, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.grid(True, alpha=0.25)
    axes.set(xlabel="training time, s of wall time", ylabel="PSNR of right halves, dB")
    axes.set_xscale("log")
    for variant, marker in zip(dict.fromkeys(name for name, _ in points), cycle(MARKERS)):
        mine = [scores for (name, _), scores in points.items() if name == variant]
        x = [value for scores in mine for value in values(scores, "train_wall_seconds")]
        y = [value for scores in mine for value in values(scores, "psnr")]
        axes.plot(x, y, marker, alpha=0.6, label=variant)
    axes.legend(frameon=False, fontsize=8, ncols=2)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=150)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
