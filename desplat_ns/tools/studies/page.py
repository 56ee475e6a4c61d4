"""The page of a study: medians over seeds, which differences are real, a plot; one HTML file that
needs no other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Any, NamedTuple

from desplat_ns.core.whole import plain_errors, write_whole
from desplat_ns.tools.pages import chart, inline_svg, plain_logarithmic, svg_of, template
from desplat_ns.tools.studies.records import Key, Record, conditions_of
from desplat_ns.tools.studies.runs import Run
from desplat_ns.tools.studies.tradeoff import BASE, SEEDS, Study, compared

TEMPLATE = Path(__file__).with_name("page.html.jinja")

SIGNIFICANT = 0.05
"""A difference is claimed where p, corrected for the number of comparisons, is no larger."""

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


class Measured(NamedTuple):
    """A variant at a length, and its scores by seed."""

    variant: str
    steps: int
    scores: Mapping[int, Mapping[str, Any]]

    def values(self, name: str) -> list[float | int]:
        """A score of each seed that has it."""
        return [row[name] for row in self.scores.values() if name in row]


def measured(runs: Iterable[Run], records: Mapping[Key, Record]) -> list[Measured]:
    """What has a record of at least one seed: the base's lengths, then the other variants."""
    scores: dict[tuple[str, int], dict[int, Mapping[str, Any]]] = {}
    for run in runs:
        if (record := records.get(run.key)) is not None:
            scores.setdefault((run.variant, run.steps), {})[run.seed] = record.scores
    points = [Measured(*cell, by_seed) for cell, by_seed in scores.items()]
    return sorted(points, key=lambda point: (point.variant != BASE, point.steps))


def p_value(gains: Sequence[float]) -> float:
    """p of a paired t-test, two-sided, of the three differences between three seeds.

    With two degrees of freedom Student's distribution has a closed form,
    P(|T| >= t) = 1 - t / sqrt(t^2 + 2), for t = mean / error.
    """
    mean, error = fmean(gains), stdev(gains) / math.sqrt(3)
    return 1 - abs(mean) / math.hypot(mean, math.sqrt(2) * error) if mean else 1.0


def corrected(p_values: Sequence[float]) -> list[float]:
    """p values for their number (Holm 1979): with a claim where the result is at most q, there is a
    false claim among them in at most a share q of such studies."""
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = largest
    return adjusted


def verdicts(points: Sequence[Measured]) -> list[str]:
    """What may be said of each point against the base at as many steps, in their order; empty
    where there is nothing to compare it with."""
    base = {point.steps: point.scores for point in points if point.variant == BASE}
    gains: list[list[float]] = []
    for point in points:
        theirs = {} if point.variant == BASE else base.get(point.steps, {})
        common = [seed for seed in point.scores if seed in theirs]
        gains.append([point.scores[seed]["psnr"] - theirs[seed]["psnr"] for seed in common])
    tested = [i for i, pairs in enumerate(gains) if len(pairs) == len(SEEDS)]
    p_values = dict(zip(tested, corrected([p_value(gains[i]) for i in tested]), strict=True))

    def verdict(i: int) -> str:
        if not gains[i]:
            return ""
        said, p = f"{fmean(gains[i]):+.2f} dB", p_values.get(i)
        if p is None:
            return f"{said}, {len(gains[i])} of {len(SEEDS)} seeds: no claim"
        value = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
        return f"{said}, {value}" if p <= SIGNIFICANT else f"{said}, not told apart ({value})"

    return [verdict(i) for i in range(len(gains))]


def write_page(study: Study) -> Path:
    """Write the page; where it is. Raises ConfigError where it cannot."""
    page, points = study.output / "report.html", measured(study.planned, study.records)
    missing = (run.name for run in study.planned if run.key not in study.records)
    with plain_errors(study.output):
        text = template(TEMPLATE, spread=spread).render(
            study=study,
            left_out=[name for name in missing if name not in study.failed],
            seeds=len(SEEDS),
            significant=SIGNIFICANT,
            columns={
                name: of for name, of in COLUMNS.items() if any(p.values(name) for p in points)
            },
            variants=compared(study.effects),
            rows=list(zip(points, verdicts(points), strict=True)),
            plot=drawn(points),
            conditions=conditions_of(study.records.values()),
        )
        write_whole(page, text.encode())
    return page


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and the range of several values; empty where there is none."""
    if not values:
        return ""
    text = format(median(values), form)
    several = len(values) > 1
    return f"{text} ({min(values):{form}} to {max(values):{form}})" if several else text


def drawn(points: Sequence[Measured]) -> str:
    """PSNR over the training time, a mark for each training, as SVG for the page."""
    with chart("training", (6.6, 4.4)) as axes:
        axes.set(xlabel="training time, s of wall time", ylabel="PSNR of right halves, dB")
        plain_logarithmic(axes.xaxis)
        variants = dict.fromkeys(point.variant for point in points)
        for variant, marker in zip(variants, cycle(MARKERS)):
            mine = [point for point in points if point.variant == variant]
            x = [value for point in mine for value in point.values("train_wall_seconds")]
            y = [value for point in mine for value in point.values("psnr")]
            axes.plot(x, y, marker, alpha=0.6, label=variant)
        axes.legend(frameon=False, fontsize=8, ncols=2)
        return inline_svg(svg_of(axes))
