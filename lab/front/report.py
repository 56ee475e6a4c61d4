"""Write docs/results/accuracy-and-time.md from the records."""

from __future__ import annotations

import json
from pathlib import Path
from string import Template

from desplat_ns.training.budget import seconds_of
from lab.documents import RESULTS
from lab.front.growth import FILE as GROWTH
from lab.front.growth import Growth
from lab.front.growth import load as load_growth
from lab.front.growth_report import growth_texts
from lab.front.kept import FILE as BUDGETS
from lab.front.kept import Kept
from lab.front.runs import (
    CHOSEN_ON,
    FILE,
    PLAN,
    REPORTED_ON,
    SETTINGS,
    downscale_of,
)
from lab.grid.figures import Figures
from lab.grid.records import Records, load
from lab.grid.sources import Cell
from lab.separation.runs import FILE as SEPARATION_RECORDS
from lab.separation.runs import SEEDS

REPORT = RESULTS / "accuracy-and-time.md"
TEMPLATE = Path(__file__).with_name("accuracy-and-time.md.template")

COLUMNS = (
    ("PSNR, dB", "psnr", ".2f"),
    ("mask IoU", "mask_iou", ".2f"),
    ("static", "num_static_gaussians", ",.0f"),
    ("CPU s", "train_cpu_seconds", ".0f"),
)


def front_table(records: Records, scenes: tuple[str, ...]) -> str:
    """One row for each scene, number of steps and setting that was measured there."""
    figures = Figures(records, SEEDS)
    planned = dict.fromkeys((run.scene, run.steps) for run in PLAN if run.scene in scenes)
    rows: list[list[str | Cell]] = []
    for scene, steps in sorted(planned, key=lambda row: (scenes.index(row[0]), row[1])):
        for setting, described in SETTINGS.items():
            key = (setting, scene, downscale_of(scene), steps)
            if figures.has(key):
                cells = [figures.cell(key, figure, form) for _, figure, form in COLUMNS]
                rows.append([f"`{scene}`", f"{steps:,}", described.what, *cells])
    return figures.table(["scene", "steps", "setting", *(name for name, _, _ in COLUMNS)], rows)


def length_texts(records: Records) -> dict[str, str]:
    """What `desplat-quick` and `desplat` reach on `clutter`, 25 and 75 visits of 40 photos."""
    texts = {}
    for name, measured, setting, steps in (
        ("quick", records, "raised", 1_000),
        ("usual", load(SEPARATION_RECORDS), "desplat", 3_000),
    ):
        figures, key = Figures(measured, SEEDS), (setting, "clutter", 2, steps)
        texts[f"{name}_clutter"] = figures.cell(key, "psnr", ".2f").text
        texts[f"{name}_seconds"] = figures.cell(key, "train_cpu_seconds", ".0f").text
    return texts


def report(records: Records, budget_rows: list[str], growth: Growth) -> str:
    """The document's text."""
    return Template(TEMPLATE.read_text("utf8")).substitute(
        **length_texts(records),
        chosen_table=front_table(records, CHOSEN_ON),
        reported_table=front_table(records, REPORTED_ON),
        budget_rows="\n".join(budget_rows),
        **growth_texts(growth),
    )


def budget_rows() -> list[str]:
    """A row for each budget that was kept or not, by scene and length."""
    runs = [Kept(**run) for run in json.loads(BUDGETS.read_text("utf8"))]
    return [kept.row() for kept in sorted(runs, key=lambda k: (k.scene, seconds_of(k.budget)))]


def write_report() -> Path:
    """Write the document; where it is."""
    REPORT.write_text(report(load(FILE), budget_rows(), load_growth(GROWTH)), "utf8")
    return REPORT
