"""Write docs/results/separation.md and a figure from the records."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import compress
from pathlib import Path

from lab.documents import CHECKOUT, DOCS
from lab.grid.figures import Figures, Key, spread
from lab.grid.records import load
from lab.grid.sources import Cell
from lab.grid.tables import table as plain_table
from lab.separation import one_pixel
from lab.separation.runs import (
    CHOSEN,
    FILE,
    HARD,
    KEPT_OUT,
    SEEDS,
    SETTINGS,
    downscale_of,
    twins_of,
)

REPORT = "results/separation.md"
FIGURE = "explain/one_pixel.png"
"""The document, and the model of one pixel."""

README = CHECKOUT / "README.md"
README_ROWS = {
    "clutter": "`fox_cluttered`, indoors, 40 photos",
    "few20": "20 photos of `fox_cluttered`",
    "around": "`monstree_cluttered`, outdoors, 18 photos",
    "castle": "`sceaux_cluttered`, a castle behind a lawn, 8 photos",
    "other-facade8": "generated house behind a lawn, 8 photos",
    "other-table20": "generated table, far background, 20 photos",
}
"""Captures in README's table, and what they are there."""

NUMBERS_S, NUMBERS_D = 59, 14
"""Numbers in which a static Gaussian (degree 3) and a distractor are stored."""


MAIN = ("off", "trimmed", "paper", "desplat", "truth")
"""Settings that the table of one scene compares."""

CAPTURES = {"chosen": CHOSEN, "kept": KEPT_OUT, "hard": HARD}
"""Captures that a table compares, by the word in the template: those on which a threshold was
chosen, those kept out of that, and one kind of difficult occluder each, pasted over the photos of
`clean`."""

STILL = {"still": "fox", "still-tree": "monstree"}
"""Captures in which nothing moves, by the names of their scenes."""


def gap(figures: Figures, setting: str, scene: str, clean: str, downscale: int, steps: int) -> Cell:
    """Share of the way from "off" to the clean twins, seed by seed."""
    runs = ((setting, scene), ("off", scene), ("off", clean))
    values, measured = figures.together("psnr", *((*run, downscale, steps) for run in runs))
    gaps = [(ours - off) / (top - off) for ours, off, top in values]
    return Cell(spread(gaps, ".2f"), tuple(measured))


def scene_table(
    figures: Figures, settings: Sequence[str], scene: str, clean: str, downscale: int, steps: int
) -> str:
    """One row for each setting that was measured."""
    rows: list[list[str | Cell]] = []
    for name in settings:
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
    """What the method costs where nothing moves, as its survey says."""
    rows: list[list[str | Cell]] = []
    for scene in STILL:
        off: Key = ("off", scene, 2, 3000)
        difference = _difference(figures, off, ("asked", scene, 2, 3000))
        if difference.text:
            rows.append([f"`{STILL[scene]}`", figures.cell(off, "psnr", ".2f"), difference])
    return figures.table(["capture", "off", "`desplat`, as its survey says"], rows)


def _difference(figures: Figures, off: Key, ours: Key) -> Cell:
    """PSNR of one setting beyond that of off, seed by seed."""
    values, measured = figures.together("psnr", off, ours)
    return Cell(spread([b - a for a, b in values], "+.2f"), tuple(measured))


def captures_table(figures: Figures, group: str, steps: int) -> str:
    """One row for each capture of a group on which `desplat` was measured."""
    rows: list[list[str | Cell]] = []
    for scene in CAPTURES[group]:
        row = _of_capture(figures, scene, steps)
        if row[1].text:
            rows.append([scene, *row])
    head = ["capture", "off", "`desplat`", "true masks", "clean twins", "gap closed", "SSIM", "IoU"]
    head += ["alpha outside", "worst view", "CPU s", "static", "distractors", "memory ratio"]
    return figures.table(*_without_empty_columns(head, rows))


def readme_table(figures: Figures) -> str:
    """The captures that stand for all, after 3,000 steps."""
    rows = []
    for scene, what in README_ROWS.items():
        off, ours, truth, clean, closed, _, iou, *_ = _of_capture(figures, scene, 3000)
        rows.append([what, *(cell.text for cell in (off, ours, truth, clean, closed, iou))])
    head = ["capture", "off, dB", "`desplat`, dB", "true masks", "clean twins", "gap closed", "IoU"]
    return plain_table(head, rows)


def with_results(text: str, results: str) -> str:
    """A page with the table between its two marks."""
    begins, ends = "<!-- results -->\n", "<!-- /results -->"
    head, _, rest = text.partition(begins)
    _, _, tail = rest.partition(ends)
    return f"{head}{begins}{results}\n{ends}{tail}"


def _without_empty_columns(
    head: list[str], rows: list[list[str | Cell]]
) -> tuple[list[str], list[list[str | Cell]]]:
    """The columns in which some row says something."""
    said = [
        any((cell if isinstance(cell, str) else cell.text) for cell in column)
        for column in zip(*rows, strict=True)
    ] or [True] * len(head)
    return list(compress(head, said)), [list(compress(row, said)) for row in rows]


def _of_capture(figures: Figures, scene: str, steps: int) -> list[Cell]:
    """Cells of `captures_table`: PSNR of four settings, the rest of `desplat`."""
    downscale = downscale_of(scene)
    clean = twins_of(scene)
    ours: Key = ("desplat", scene, downscale, steps)
    four: list[Key] = [
        ("off", scene, downscale, steps),
        ours,
        ("truth", scene, downscale, steps),
        ("off", clean, downscale, steps),
    ]
    cells = [figures.cell(run, "psnr", ".2f") for run in four]
    cells.append(gap(figures, "desplat", scene, clean, downscale, steps))
    for figure, form in (
        ("ssim", ".3f"),
        ("mask_iou", ".2f"),
        ("alpha_outside_masks", ".3f"),
        ("psnr_worst", ".2f"),
        ("train_cpu_seconds", ".0f"),
        ("num_static_gaussians", ",.0f"),
        ("num_distractor_gaussians", ",.0f"),
    ):
        cells.append(figures.cell(ours, figure, form))
    measured = figures.by_seed(ours).values()
    ratios = [
        record.figures["num_distractor_gaussians"]
        * NUMBERS_D
        / (record.figures["num_static_gaussians"] * NUMBERS_S)
        for _, record in measured
    ]
    return [*cells, Cell(spread(ratios, ".2f"), tuple(measured))]


def write_committed_report() -> Path:
    """Write the document and README's table from the committed records; returns where the first
    is."""
    figures = Figures(load(FILE), SEEDS)
    README.write_text(with_results(README.read_text(), readme_table(figures)))
    return write_report(figures)


def write_report(figures: Figures, folder: Path = DOCS) -> Path:
    """Fill in the template; returns where the document is."""
    target = folder / REPORT
    figure = folder / FIGURE
    for path in (target, figure):
        path.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(_filled(target.name, figures))
    one_pixel.draw(figure)
    return target


def _filled(name: str, figures: Figures) -> str:
    """The template of a document, its tables made of these figures."""

    def table(match: re.Match[str]) -> str:
        kind, *rest = match[1].split()
        if kind == "still":
            return still_table(figures)
        if kind == "captures":
            return captures_table(figures, rest[0], 3000)
        return scene_table(figures, MAIN, "clutter", "clean", 2, int(rest[0]))

    template = Path(__file__).with_name(f"{name}.template")
    return re.sub(r"\{\{(.*?)\}\}", table, template.read_text())
