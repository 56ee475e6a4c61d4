"""How many visits of each photo pay: runs of `desplat` by their length, from the records of
`lab.separation`."""

from __future__ import annotations

from lab.grid.figures import Figures
from lab.grid.records import load
from lab.grid.sources import Cell
from lab.separation.records import FILE as RECORDS
from lab.separation.runs import SEEDS
from lab.separation.runs import STUDY as SEPARATION

PHOTOS = {"yard8": 8, "around": 18, "yard24": 24, "clutter": 40, "yard60": 60}
"""Training photos of each scene."""

LENGTHS = (1_000, 3_000, 7_000, 30_000)
"""Steps."""


def lengths_table() -> str:
    """A row for each scene, a column for each length: visits of a photo, and PSNR."""
    figures = Figures(load(RECORDS), SEPARATION.settings_of, SEEDS)
    rows: list[list[str | Cell]] = []
    for scene, photos in PHOTOS.items():
        row: list[str | Cell] = [f"`{scene}`", str(photos)]
        for steps in LENGTHS:
            key = ("desplat", scene, 2 if scene in ("clutter", "around") else 1, steps)
            measured = figures.has(key)
            row += [f"{steps / photos:.0f}" if measured else ""]
            row += [figures.cell(key, "psnr", ".2f") if measured else ""]
        rows.append(row)
    head = [part for steps in LENGTHS for part in ("visits", f"dB at {steps:,} steps")]
    return figures.table(["scene", "photos", *head], rows)
