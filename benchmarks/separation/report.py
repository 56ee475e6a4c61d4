"""Write docs/separation.md and its figure from the records."""

from __future__ import annotations

import re
from pathlib import Path
from statistics import median
from string import Template
from typing import Any

from benchmarks.documents import DOCS
from benchmarks.separation import one_pixel
from benchmarks.separation.runs import ABLATIONS, CLEAN, HARD, OTHERS, SEEDS, SETTINGS, Run
from desplat_ns.studies.grid.tables import table

TEMPLATE = Path(__file__).with_name("separation.md.template")
FOLDER = DOCS
REPORT, FIGURE = "separation.md", "separation.png"
NOT_YET = "not measured"

NUMBERS_S, NUMBERS_D = 59, 14
"""Numbers in which a static Gaussian (degree 3) and a distractor are stored."""

Records = dict[str, dict[str, Any]]


class Figures:
    """Medians over the seeds that were measured."""

    def __init__(self, records: Records):
        self.records = records

    def by_seed(self, run: tuple[str, str, int, int], figure: str) -> dict[int, float]:
        """The values of the seeds that were measured."""
        found = {seed: self.records.get(Run(*run, seed).name, {}) for seed in SEEDS}
        return {seed: record[figure] for seed, record in found.items() if figure in record}

    def values(self, run: tuple[str, str, int, int], figure: str) -> list[float]:
        """One value for each seed that was measured."""
        return list(self.by_seed(run, figure).values())

    def together(self, *runs: tuple[str, str, int, int]) -> list[tuple[float, ...]]:
        """PSNR of several runs, for each seed of which all were measured."""
        values = [self.by_seed(run, "psnr") for run in runs]
        return [tuple(v[s] for v in values) for s in SEEDS if all(s in v for v in values)]

    def gaps(self, setting: str, scene: str, clean: str, downscale: int, steps: int) -> list[float]:
        """Share of the way from "off" to the clean twins, seed by seed."""
        runs = ((setting, scene), ("off", scene), ("off", clean))
        values = self.together(*((*run, downscale, steps) for run in runs))
        return [(ours - off) / (top - off) for ours, off, top in values]

    def cell(self, run: tuple[str, str, int, int], figure: str, form: str) -> str:
        return spread(self.values(run, figure), form)


def spread(values: list[float], form: str) -> str:
    """Median, and in brackets the least and the largest of several."""
    if not values:
        return ""
    text = format(median(values), form)
    if len(values) == 1:
        return text
    return f"{text} ({format(min(values), form)} - {format(max(values), form)})"


def scene_table(
    figures: Figures, settings: str, scene: str, clean: str, downscale: int, steps: int
) -> str:
    """One row for each setting that was measured."""
    rows = []
    for name in settings.split():
        run = (name, scene, downscale, steps)
        if not figures.values(run, "psnr"):
            continue
        rows.append(
            [
                SETTINGS[name].what,
                figures.cell(run, "psnr", ".2f"),
                spread(figures.gaps(name, scene, clean, downscale, steps), ".2f"),
                figures.cell(run, "ssim", ".3f"),
                figures.cell(run, "mask_iou", ".2f"),
                figures.cell(run, "alpha_outside_masks", ".3f"),
                figures.cell(run, "num_static_gaussians", ",.0f"),
                figures.cell(run, "num_distractor_gaussians", ",.0f"),
            ]
        )
    twins = ("off", clean, downscale, steps)
    if figures.values(twins, "psnr"):
        psnr, ssim = (
            figures.cell(twins, f, form) for f, form in (("psnr", ".2f"), ("ssim", ".3f"))
        )
        count = figures.cell(twins, "num_static_gaussians", ",.0f")
        rows.append(["off, trained on the clean twins", psnr, "1", ssim, "", "", count, ""])
    head = ["", "PSNR", "gap closed", "SSIM", "mask IoU", "alpha outside", "static", "distractors"]
    return table(head, rows) if rows else f"*{NOT_YET} yet*"


def still_table(figures: Figures) -> str:
    """What the method costs where nothing moves."""
    rows = []
    for steps in (1000, 3000, 30000):
        off, ours = ((setting, "still", 2, steps) for setting in ("off", "desplat"))
        differences = [b - a for a, b in figures.together(off, ours)]
        if differences:
            cells = [figures.cell(run, "psnr", ".2f") for run in (off, ours)]
            cells.append(spread(differences, "+.2f"))
            rows.append([f"{steps:,}", *cells])
    head = ["steps", "off", "`desplat`", "difference"]
    return table(head, rows) if rows else f"*{NOT_YET} yet*"


def hard_table(figures: Figures, steps: int) -> str:
    """One row for each kind of difficult occluder."""
    rows = []
    for scene in HARD:
        off, ours = ((setting, scene, 2, steps) for setting in ("off", "desplat"))
        if not figures.values(ours, "psnr"):
            continue
        gap = figures.gaps("desplat", scene, "clean", 2, steps)
        cells = [figures.cell(run, "psnr", ".2f") for run in (off, ours)]
        scores = [
            figures.cell(ours, "mask_iou", ".2f"),
            figures.cell(ours, "alpha_outside_masks", ".3f"),
        ]
        rows.append([scene, *cells, spread(gap, ".2f"), *scores])
    head = ["", "off", "`desplat`", "gap closed", "mask IoU", "alpha outside"]
    return table(head, rows) if rows else f"*{NOT_YET} yet*"


def changes_table(before: Figures, now: Figures, steps: int) -> str:
    """For each capture a row with refinement as it was, and one with refinement as it is."""
    rows = []
    for scene, downscale in (("clutter", 2), *((s, 2 if s == "around" else 1) for s in OTHERS)):
        clean = "clean" if scene == "clutter" else scene + CLEAN
        for name, figures in (("before", before), ("now", now)):
            row = _of_capture(figures, scene, clean, downscale, steps)
            if any(row):
                rows.append([scene, name, *row])
    head = ["capture", "", "off", "`desplat`", "clean twins", "SSIM", "IoU", "alpha outside"]
    head += ["training, CPU s", "static", "distractors", "memory ratio"]
    return table(head, rows) if rows else f"*{NOT_YET} yet*"


def _of_capture(figures: Figures, scene: str, clean: str, downscale: int, steps: int) -> list[str]:
    """Cells of `changes_table`: PSNR of three settings, the rest of `desplat`."""
    off, ours, twins = (("off", scene), ("desplat", scene), ("off", clean))
    cells = [figures.cell((*run, downscale, steps), "psnr", ".2f") for run in (off, ours, twins)]
    run = (*ours, downscale, steps)
    for figure, form in (
        ("ssim", ".3f"),
        ("mask_iou", ".2f"),
        ("alpha_outside_masks", ".3f"),
        ("train_cpu_seconds", ".0f"),
        ("num_static_gaussians", ",.0f"),
        ("num_distractor_gaussians", ",.0f"),
    ):
        cells.append(figures.cell(run, figure, form))
    counts = (
        figures.by_seed(run, name) for name in ("num_distractor_gaussians", "num_static_gaussians")
    )
    distractors, static = counts
    ratios = [distractors[s] * NUMBERS_D / (static[s] * NUMBERS_S) for s in static]
    return [*cells, spread(ratios, ".2f")]


def write_report(records: Records, before: Records, folder: Path = FOLDER) -> Path:
    """Fill in the template; returns where the document is.

    Args:
        before: those of `records.BEFORE`.
    """
    figures, old = Figures(records), Figures(before)
    main = "off trimmed paper desplat truth"

    def filled(match: re.Match[str]) -> str:
        settings, scene, clean, downscale, steps, *which = match[1].split("/")
        chosen = {"main": main, "ablations": f"desplat {ABLATIONS}", "short": "off desplat"}
        source = old if which == ["before"] else figures
        return scene_table(source, chosen[settings], scene, clean, int(downscale), int(steps))

    text = re.sub(r"\{\{table ([^}]*)\}\}", filled, TEMPLATE.read_text())
    text = Template(text).substitute(
        still=still_table(figures),
        still_before=still_table(old),
        hard_1000=hard_table(old, 1000),
        hard_3000=hard_table(old, 3000),
        **{f"changes_{steps}": changes_table(old, figures, steps) for steps in (1000, 3000, 7000)},
    )
    path = folder / REPORT
    path.write_text(text)
    one_pixel.draw(folder / FIGURE)
    return path
