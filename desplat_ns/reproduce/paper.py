"""Figures of the paper's tables, as far as its supplement has them: Tables A5 to A9.

The tables of the main text are not in it, so that nothing of RobustNeRF's and On-the-go's PSNR,
SSIM and LPIPS is here. Rows are called as in the text: DeSplat, and DeSplat-A without background.

`paper.txt` has a line for each row: table and metrics, row, and the figures scene by scene in the
order of `tables.TABLES`, a dash where the paper has one. A7 to A9 have the mean behind them. A8 is
in minutes:seconds. The mean of Splatfacto's eleven figures of A9 is 94.10; the paper prints 94.01.
"""

from __future__ import annotations

from functools import cache, reduce
from pathlib import Path

from desplat_ns.reproduce.tables import TABLES, TableName

MEAN = "mean"
"""The column of means over all scenes of a table."""

Figures = dict[tuple[str, str, str], float | None]
"""By row, scene and metric."""


@cache
def figures_of(table: TableName) -> Figures:
    """All figures of a table; none of one that is in the main text. A8 in seconds."""
    figures: Figures = {}
    columns = [*(scene.name for scene in TABLES[table].scenes), MEAN]
    for line in Path(__file__).with_suffix(".txt").read_text("utf8").splitlines():
        of, row, values = (part.strip() for part in line.split("|"))
        name, *metrics = of.split()
        if name == table:
            places = [(row, scene, metric) for scene in columns for metric in metrics]
            figures |= zip(places, map(_number, values.split()), strict=False)  # A5, A6: no mean
    return figures


def published(table: TableName, row: str, scene: str, metric: str) -> float | None:
    """A figure of the paper; None where there is none."""
    return figures_of(table).get((row, scene, metric))


def rows_of(table: TableName) -> list[str]:
    """All rows of a table of the paper."""
    return list(dict.fromkeys(row for row, _, _ in figures_of(table)))


def _number(word: str) -> float | None:
    """A figure, or the seconds of `minutes:seconds` or `hours:minutes:seconds`; None of a dash."""
    if word == "-":
        return None
    return reduce(lambda total, part: 60 * total + part, map(float, word.split(":")))
