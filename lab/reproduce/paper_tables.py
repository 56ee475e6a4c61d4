"""Write the paper's figures that docs/compare-with-desplat.md shows.

python -m lab.reproduce.paper_tables
"""

from __future__ import annotations

import re

from desplat_ns.reproduce.paper import PUBLISHED
from lab.documents import DOCS
from lab.grid.tables import table

PAGE = DOCS / "compare-with-desplat.md"

ROWS = {
    "A5": ("Splatfacto", "Splatfacto-W", "Splatfacto-W-A", "DeSplat-A", "DeSplat"),
    "A6": ("Splatfacto", "DeSplat"),
}
"""By table of the paper: its rows that this package has a method for."""


def paper_table(name: str) -> str:
    """A table as the paper has it, one column for each scene."""
    (published,) = PUBLISHED[name]
    rows = [
        [row, *(" / ".join(_figures(name, row, scene)) for scene in published.scenes)]
        for row in ROWS[name]
    ]
    return table(["", *published.scenes], rows)


def _figures(name: str, row: str, scene: str) -> list[str]:
    (published,) = PUBLISHED[name]
    figures = ((metric, published.figure(row, scene, metric)) for metric in published.metrics)
    return [f"{value:.2f}" if metric == "psnr" else f"{value:.3f}" for metric, value in figures]


def filled(text: str) -> str:
    """A page with the tables between their marks."""

    def with_table(match: re.Match[str]) -> str:
        return f"<!-- paper {match[1]} -->\n{paper_table(match[1])}\n<!-- /paper {match[1]} -->"

    return re.sub(r"<!-- paper (\w+) -->\n.*?<!-- /paper \1 -->", with_table, text, flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text("utf8")), "utf8")
    print(PAGE)
