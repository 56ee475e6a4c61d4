"""The report of a study: one HTML file that needs no other, and the plots beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from desplat_ns.files.pages import data_address, inline_svg, template
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.studies.machine import short
from desplat_ns.studies.plan import BASE, SEEDS, compared
from desplat_ns.studies.plots import MORE, draw_all
from desplat_ns.studies.results import RUNS, Results
from desplat_ns.studies.summary import (
    NEEDED,
    SIGNIFICANT,
    Measured,
    Spread,
    best_within,
    decibels_to_tell,
    finals,
    least_ratio,
    measured,
    on_front,
    soonest_at,
    times_to_tell,
    verdicts,
)
from desplat_ns.studies.train_and_score import PICTURES

FILE = "report.html"
TEMPLATE = Path(__file__).with_name("report.html.jinja")

PICTURE_SIDE, PICTURE_QUALITY = 900, 85
"""Pixels of the longer side, and JPEG's, of pictures in the report."""


def write_report(folder: Path, results: Results) -> Path:
    """Draw the plots and write the report; where it is. Raises ConfigError where it cannot."""
    points = measured_of(results)
    with plain_errors(folder):
        plots = draw_all(folder, points)
    defaults = [point for point in points if point.variant == BASE]
    within = [(seconds, best_within(seconds, defaults)) for seconds in times_to_tell(defaults)]
    reached = [(db, soonest_at(db, defaults)) for db in decibels_to_tell(defaults)]
    claims = [said for said in verdicts(finals(points)) if said and "no claim" not in said]
    text = template(TEMPLATE, spread=spread).render(
        capture=results.capture,
        effects=results.capture.effects.words or "none",
        results=results,
        seeds=NEEDED,
        significant=SIGNIFICANT,
        comparisons=len(claims),
        least_ratio=least_ratio(len(claims)),
        rows=training_rows(points, results),
        more=[MORE[name] for name in names_of(points)],
        within=[(seconds, point) for seconds, point in within if point is not None],
        reached=[(db, point) for db, point in reached if point is not None],
        on_the_front=front_in_words(points),
        plots={name: inline_svg((folder / f"{name}.svg").read_text("utf8")) for name in plots},
        pictures=pictures_of(folder, points),
        code=short(results.code),
    )
    with plain_errors(folder):
        write_whole(folder / FILE, text.encode())
    return folder / FILE


def measured_of(results: Results) -> list[Measured]:
    """What its trainings say, in the order of the plan."""
    if results.plan is None:
        return []
    return measured(results.plan.runs(results.capture), results.training)


def training_rows(points: Sequence[Measured], results: Results) -> list[dict[str, Any]]:
    """Whole runs in words: the base's lengths first, then other variants at the comparison's."""
    ends = sorted(finals(points), key=lambda point: (point.variant != BASE, point.steps))
    variants, front, said = compared(results.capture.effects), on_front(ends), verdicts(ends)
    return [
        {
            "what": variants[point.variant].what,
            "steps": point.steps,
            "psnr": spread(point.psnr, ".2f"),
            "more": [_figure(point, name, ".3f") for name in names_of(ends)],
            "wall": spread(point.wall, ".0f"),
            "cpu": _figure(point, "train_cpu_seconds", ".0f"),
            "static": _figure(point, "num_static_gaussians", ",.0f", alone=True),
            "distractors": _figure(point, "num_distractor_gaussians", ",.0f", alone=True),
            "seeds": len(point.seeds),
            "verdict": said[index],
            "is_on_front": index in front,
            "is_base": point.variant == BASE,
        }
        for index, point in enumerate(ends)
    ]


def names_of(points: Sequence[Measured]) -> list[str]:
    """Those of `MORE` that were measured of any run."""
    return [name for name in MORE if any(name in point.figures for point in points)]


def spread(values: Spread, form: str) -> str:
    """Median, and the range of several seeds."""
    text = format(values.median, form)
    if len(values.values) == 1:
        return text
    return f"{text} ({values.least:{form}} to {values.most:{form}})"


def _figure(point: Measured, name: str, form: str, alone: bool = False) -> str:
    values = point.figures.get(name)
    if values is None:
        return ""
    return format(values.median, form) if alone else spread(values, form)


def front_in_words(points: Sequence[Measured]) -> str:
    """Whether the defaults are worth their time, and what beats them if they are not."""
    ends = finals(points)
    if not ends:
        return ""
    front = on_front(ends)
    beaten = [o for i, o in enumerate(ends) if o.variant == BASE and i not in front]
    if not beaten:
        return "Every length of the defaults lies on the front."
    better = {ends[i].variant for i in front if ends[i].variant != BASE}
    lengths = ", ".join(f"{p.steps:,}" for p in sorted(beaten, key=lambda p: p.steps))
    return (
        f"The defaults at {lengths} steps lie behind the front, by medians. On it are also: "
        f"{', '.join(sorted(better)) or 'other lengths of the defaults alone'}. The table says "
        "what may be claimed of each."
    )


def pictures_of(folder: Path, points: Sequence[Measured]) -> list[dict[str, str]]:
    """The first held-out photo beside its rendering, by the shortest and by the best run."""
    ends = [point for point in finals(points) if point.variant == BASE]
    if not ends:
        return []
    shortest = min(ends, key=lambda point: point.steps)
    best = max(ends, key=lambda point: point.psnr.median)
    shown = []
    for steps in dict.fromkeys((shortest.steps, best.steps)):
        name = f"{BASE}-{steps}-{SEEDS[0]}"
        found_pictures = sorted((folder / RUNS / name / PICTURES).glob("eval_img_*.png"))
        if found_pictures:
            pixels = np.asarray(Image.open(found_pictures[0]).convert("RGB"))
            data = data_address(pixels, PICTURE_SIDE, PICTURE_QUALITY, "JPEG")
            shown.append({"steps": f"{steps:,}", "data": data})
    return shown
