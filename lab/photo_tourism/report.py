"""Write docs/results/photo_tourism.md from the records."""

from __future__ import annotations

from pathlib import Path
from string import Template

from lab.documents import RESULTS
from lab.grid.figures import Figures
from lab.grid.records import Records, load
from lab.grid.sources import Cell
from lab.photo_tourism.runs import FILE, SEED, SETTINGS, STEPS, key_of

REPORT = RESULTS / "photo_tourism.md"
TEMPLATE = Path(__file__).with_name("photo_tourism.md.template")

COLUMNS = {
    "PSNR, dB": ("psnr", ".2f"),
    "SSIM": ("ssim", ".3f"),
    "average light": ("psnr_before", ".2f"),
    "mask IoU": ("mask_iou", ".2f"),
    "alpha outside": ("alpha_outside_masks", ".3f"),
    "static": ("num_static_gaussians", ",.0f"),
    "distractors": ("num_distractor_gaussians", ",.0f"),
    "training, CPU s": ("train_cpu_seconds", ",.0f"),
}
"""Figures, and how they are written."""


def scene_table(records: Records, scene: str) -> str:
    """One row for each setting that was measured."""
    figures, rows = Figures(records, (SEED,)), list[list[str | Cell]]()
    for name, setting in SETTINGS.items():
        key = key_of(name, scene)
        if figures.has(key):
            cells = [figures.cell(key, *column) for column in COLUMNS.values()]
            rows.append([setting.what, *cells])
    return figures.table(["effects that are on", *COLUMNS], rows)


def report(records: Records) -> str:
    """The document's text."""
    values: dict[str, object] = {f"table_{s}": scene_table(records, s) for s in STEPS}
    return Template(TEMPLATE.read_text()).substitute(
        values, **{f"steps_{scene}": f"{steps:,}" for scene, steps in STEPS.items()}
    )


def write_report() -> Path:
    """Write the document from the file in docs/; returns where it is."""
    REPORT.write_text(report(load(FILE)))
    return REPORT
