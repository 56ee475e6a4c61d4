"""The page of a study: medians over seeds, which differences are real, and a plot."""

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from statistics import fmean, median
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from scipy.stats import ttest_1samp

from desplat_ns.core.pages import template
from desplat_ns.core.whole import plain_errors, write_whole
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
STYLE: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "training"}
STYLE |= {"font.size": 10, "font.family": "sans-serif"}
"""Of the chart."""
Scores = Mapping[int, Mapping[str, Any]]
"""By seed."""
Point = tuple[str, int]
"""A variant and a length."""


def measured(runs: Iterable[Run], records: Mapping[Key, Record]) -> dict[Point, Scores]:
    """What has a record of at least one seed: the base's lengths, then the other variants."""
    points: dict[Point, dict[int, Mapping[str, Any]]] = {}
    for run in sorted(runs, key=lambda run: (run.variant != BASE, run.steps)):
        if (record := records.get(run.key)) is not None:
            points.setdefault((run.variant, run.steps), {})[run.seed] = record.scores
    return dict(points)


def values(scores: Scores, name: str) -> list[float | int]:
    """A score of each seed that has it."""
    return [row[name] for row in scores.values() if name in row]


def corrected(p_values: Sequence[float] | np.ndarray) -> list[float]:
    """p values for their number (Holm 1979): with a claim where the result is at most q, there is a
    false claim among them in at most a share q of such studies."""
    order = np.argsort(p_values)
    raised = np.asarray(p_values)[order] * np.arange(len(order), 0, -1)
    return np.maximum.accumulate(raised).clip(max=1.0)[np.argsort(order)].tolist()


def verdicts(points: Mapping[Point, Scores]) -> dict[Point, str]:
    """What may be said of each point against the base at as many steps, by a paired t-test; empty
    where there is nothing to compare it with."""
    gains, p_values = dict[Point, list[float]](), dict[Point, float]()
    for (variant, steps), scores in points.items():
        base = {} if variant == BASE else points.get((BASE, steps), {})
        common = [seed for seed in scores if seed in base]
        gains[variant, steps] = [scores[seed]["psnr"] - base[seed]["psnr"] for seed in common]
    tested = [point for point, pairs in gains.items() if len(pairs) == len(SEEDS)]
    found = [ttest_1samp(gains[point], 0.0)[1] for point in tested]  # NaN where all are 0
    p_values |= zip(tested, corrected(np.nan_to_num(found, nan=1.0)), strict=True)

    def verdict(point: Point) -> str:
        if not gains[point]:
            return ""
        said, p = f"{fmean(gains[point]):+.2f} dB", p_values.get(point)
        if p is None:
            return f"{said}, {len(gains[point])} of {len(SEEDS)} seeds: no claim"
        value = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
        return f"{said}, {value}" if p <= SIGNIFICANT else f"{said}, not told apart ({value})"

    return {point: verdict(point) for point in points}


def write_page(study: Study) -> Path:
    """Write the page; where it is. Raises ConfigError where it cannot."""
    page, points = study.output / "report.html", measured(study.planned, study.records)
    with plain_errors(study.output):
        text = template(TEMPLATE, spread=spread, values=values).render(
            study=study,
            left_out=[run.name for run in study.missing if run.name not in study.failed],
            seeds=len(SEEDS),
            significant=SIGNIFICANT,
            columns={
                name: of
                for name, of in COLUMNS.items()
                if any(values(scores, name) for scores in points.values())
            },
            variants=compared(study.effects),
            points=points,
            verdicts=verdicts(points),
            plot=drawn(points),
            conditions=conditions_of(study.records.values()),
        )
        write_whole(page, text.encode())
    return page


def spread(values: Sequence[float | int], form: str) -> str:
    """Median, and the range of several values; empty where there is none."""
    if not values:
        return ""
    text = f"{median(values):{form}}"
    return f"{text} ({min(values):{form}} to {max(values):{form}})" if len(values) > 1 else text


def drawn(points: Mapping[Point, Scores]) -> str:
    """PSNR over the training time, a mark for each training, as SVG for HTML: without prologue,
    metadata, name spaces and a size of its own."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.6, 4.4), layout="constrained")
        axes = figure.subplots()
        axes.grid(True, which="major", alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set(xlabel="training time, s of wall time", ylabel="PSNR of right halves, dB")
        axes.set_xscale("log")  # with numbers as 0.5, 20, 1,000 instead of powers of ten
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.10g}"))
        for variant, marker in zip(dict.fromkeys(name for name, _ in points), cycle(MARKERS)):
            mine = [scores for (name, _), scores in points.items() if name == variant]
            x = [value for scores in mine for value in values(scores, "train_wall_seconds")]
            y = [value for scores in mine for value in values(scores, "psnr")]
            axes.plot(x, y, marker, alpha=0.6, label=variant)
        axes.legend(frameon=False, fontsize=8, ncols=2)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = re.sub(r"<metadata>.*?</metadata>", "", file.getvalue(), flags=re.DOTALL)
    tag, rest = text[text.index("<svg") :].split(">", 1)
    return re.sub(r' (?:width|height|xmlns(?::\w+)?)="[^"]*"', "", tag) + ">" + rest
