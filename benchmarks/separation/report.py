"""Write docs/separation.md, docs/separation_tried.md and a figure from the records."""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.documents import DOCS
from benchmarks.separation import one_pixel
from benchmarks.separation.records import BEFORE, FILE
from benchmarks.separation.runs import ABLATIONS, CLEAN, HARD, OTHERS, SEEDS, SETTINGS, STUDY
from desplat_ns.studies.grid.figures import Figures, spread
from desplat_ns.studies.grid.records import Records, load
from desplat_ns.studies.grid.sources import Cell, Reference

REPORT, TRIED, FIGURE = "separation.md", "separation_tried.md", "separation.png"
"""What is so today; what was so once, or was not kept; the model of one pixel."""

NUMBERS_S, NUMBERS_D = 59, 14
"""Numbers in which a static Gaussian (degree 3) and a distractor are stored."""


SHOWN = {
    "main": "off trimmed paper desplat truth",
    "ablations": f"desplat {ABLATIONS}",
    "short": "off desplat",
}
"""Settings that a table of one scene compares, by the word in the template."""


def gap(figures: Figures, setting: str, scene: str, clean: str, downscale: int, steps: int) -> Cell:
    """Share of the way from "off" to the clean twins, seed by seed."""
    runs = ((setting, scene), ("off", scene), ("off", clean))
    values, measured = figures.together("psnr", *((*run, downscale, steps) for run in runs))
    gaps = [(ours - off) / (top - off) for ours, off, top in values]
    return Cell(spread(gaps, ".2f"), tuple(measured))


def scene_table(
    figures: Figures, settings: str, scene: str, clean: str, downscale: int, steps: int
) -> str:
    """One row for each setting that was measured."""
    rows: list[list[str | Cell]] = []
    for name in settings.split():
        run = (name, scene, downscale, steps)
        if not figures.has(run):
            continue
        rows.append(
            [
                SETTINGS[name].what,
                figures.cell(run, "psnr", ".2f"),
                gap(figures, name, scene, clean, downscale, steps),
                figures.cell(run, "ssim", ".3f"),
                figures.cell(run, "mask_iou", ".2f"),
                figures.cell(run, "alpha_outside_masks", ".3f"),
                figures.cell(run, "num_static_gaussians", ",.0f"),
                figures.cell(run, "num_distractor_gaussians", ",.0f"),
            ]
        )
    twins = ("off", clean, downscale, steps)
    if figures.has(twins):
        psnr, ssim = (
            figures.cell(twins, f, form) for f, form in (("psnr", ".2f"), ("ssim", ".3f"))
        )
        count = figures.cell(twins, "num_static_gaussians", ",.0f")
        rows.append(["off, trained on the clean twins", psnr, "1", ssim, "", "", count, ""])
    head = ["", "PSNR", "gap closed", "SSIM", "mask IoU", "alpha outside", "static", "distractors"]
    return figures.table(head, rows)


def still_table(figures: Figures) -> str:
    """What the method costs where nothing moves."""
    rows: list[list[str | Cell]] = []
    for steps in (1000, 3000, 30000):
        off, ours = ((setting, "still", 2, steps) for setting in ("off", "desplat"))
        values, measured = figures.together("psnr", off, ours)
        if values:
            difference = Cell(spread([b - a for a, b in values], "+.2f"), tuple(measured))
            cells = [figures.cell(run, "psnr", ".2f") for run in (off, ours)]
            rows.append([f"{steps:,}", *cells, difference])
    return figures.table(["steps", "off", "`desplat`", "difference"], rows)


def hard_table(figures: Figures, steps: int) -> str:
    """One row for each kind of difficult occluder."""
    rows: list[list[str | Cell]] = []
    for scene in HARD:
        off, ours = ((setting, scene, 2, steps) for setting in ("off", "desplat"))
        if not figures.has(ours):
            continue
        cells = [figures.cell(run, "psnr", ".2f") for run in (off, ours)]
        scores = [
            figures.cell(ours, "mask_iou", ".2f"),
            figures.cell(ours, "alpha_outside_masks", ".3f"),
        ]
        rows.append([scene, *cells, gap(figures, "desplat", scene, "clean", 2, steps), *scores])
    return figures.table(["", "off", "`desplat`", "gap closed", "mask IoU", "alpha outside"], rows)


def captures_table(figures: Figures, steps: int) -> str:
    """One row for each capture that was measured."""
    rows: list[list[str | Cell]] = []
    for scene, downscale in (("clutter", 2), *((s, 2 if s == "around" else 1) for s in OTHERS)):
        clean = "clean" if scene == "clutter" else scene + CLEAN
        row = _of_capture(figures, scene, clean, downscale, steps)
        if any(cell.text for cell in row):
            rows.append([scene, *row])
    head = ["capture", "off", "`desplat`", "clean twins", "SSIM", "IoU", "alpha outside"]
    head += ["training, CPU s", "static", "distractors", "memory ratio"]
    return figures.table(head, rows)


def _of_capture(figures: Figures, scene: str, clean: str, downscale: int, steps: int) -> list[Cell]:
    """Cells of `captures_table`: PSNR of three settings, the rest of `desplat`."""
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
    measured = figures.by_seed(run).values()
    ratios = [
        record.figures["num_distractor_gaussians"]
        * NUMBERS_D
        / (record.figures["num_static_gaussians"] * NUMBERS_S)
        for _, record in measured
    ]
    return [*cells, Cell(spread(ratios, ".2f"), tuple(measured))]


def write_committed_report() -> Path:
    """Write both documents from the files in docs/; returns where the first is."""
    return write_report(load(FILE), load(BEFORE))


def write_report(
    now: Records, before: Records, folder: Path = DOCS, today: Reference = STUDY.settings_of
) -> Path:
    """Fill in the templates; returns where the document of today is.

    Args:
        before: those of `records.BEFORE`.
        today: see `sources`.
    """
    for name, figures in (
        (REPORT, Figures(now, today, SEEDS)),
        (TRIED, Figures(before, None, SEEDS)),
    ):
        (folder / name).write_text(_filled(name, figures))
    one_pixel.draw(folder / FIGURE)
    return folder / REPORT


def _filled(name: str, figures: Figures) -> str:
    """The template of a document, its tables made of these figures."""

    def table(match: re.Match[str]) -> str:
        kind, *rest = match[1].split()
        if kind == "still":
            return still_table(figures)
        if kind in ("hard", "captures"):
            return (hard_table if kind == "hard" else captures_table)(figures, int(rest[0]))
        scene, clean, downscale, steps = rest
        return scene_table(figures, SHOWN[kind], scene, clean, int(downscale), int(steps))

    template = Path(__file__).with_name(f"{name}.template")
    return re.sub(r"\{\{(.*)\}\}", table, template.read_text())
