"""A table in files: Markdown, HTML, CSV, LaTeX and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from desplat_ns.files.pages import template
from desplat_ns.files.whole import plain_errors, whole_folder
from desplat_ns.reproduce.results import (
    SMOKE,
    Results,
    conditions_of,
    header,
    number_of_seeds,
    rows,
    words,
)

TEMPLATE = Path(__file__).with_name("table.html.jinja")


def write_table(folder: Path, results: Results) -> None:
    """Write table.md, .html, .csv, .tex and .json. Raises ConfigError where it cannot."""
    texts = {
        "table.md": markdown(results),
        "table.html": html(results),
        "table.csv": comma_separated(results),
        "table.tex": latex(results),
        "table.json": json.dumps(as_json(results), indent=1) + "\n",
    }
    with plain_errors(folder), whole_folder(folder) as draft:
        for name, text in texts.items():
            (draft / name).write_text(text, "utf8")


def as_json(results: Results) -> dict[str, Any]:
    """Everything; differences are ours less the paper's."""
    return {
        "table": results.table.name,
        "title": results.table.title,
        "smoke": results.is_smoke,
        "cells": [
            {
                "scene": cell.scene,
                "method": cell.method,
                "metric": cell.metric.name,
                "values": list(cell.values),
                "mean": cell.mean,
                "paper": cell.paper,
                "difference": cell.difference,
            }
            for cell in results.cells
        ],
        "conditions": conditions_of(results),
        "missing scenes": list(results.missing),
        "failed": dict(results.failed),
    }


def comma_separated(results: Results) -> str:
    """One row for each figure."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    names = ("table", "smoke", "scene", "method", "metric", "seeds", "mean", "paper", "difference")
    table.writerow(names)
    for cell in results.cells:
        row = (results.table.name, results.is_smoke, cell.scene, cell.method, cell.metric.name)
        figures = (cell.mean, cell.paper, cell.difference)
        written = ("" if figure is None else f"{figure:.6g}" for figure in figures)
        table.writerow((*row, len(cell.values), *written))
    return file.getvalue()


def markdown(results: Results) -> str:
    """A table for each figure, then the conditions."""
    lines = [f"# {results.table.title}", ""]
    lines += [f"**{SMOKE}**", ""] if results.is_smoke else []
    lines += [results.table.note, ""] if results.table.note and not results.is_smoke else []
    lines += [number_of_seeds(results), ""]
    names = header(results)
    for metric in results.table.metrics:
        lines += [f"## {metric.title}", "", _line(names), _line(["---"] * len(names))]
        lines += [*(_line(row.texts) for row in rows(results, metric)), ""]
    if results.missing:
        lines += [f"Scenes that were not there: {', '.join(results.missing)}.", ""]
    lines += [f"- Failed: {name}: {' '.join(why.split())}" for name, why in results.failed.items()]
    lines += ["", "## Conditions", ""]
    lines += [
        f"- {name}: {words(value)}" for name, value in conditions_of(results).items() if value
    ]
    return "\n".join([*lines, ""])


def _line(texts: Sequence[str]) -> str:
    return f"| {' | '.join(texts)} |"


_LATEX = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
}
_LATEX |= {letter: rf"\{letter}" for letter in "&%$#_{}"}


def latex(results: Results) -> str:
    """The tables of the Markdown page, with booktabs."""

    def line(texts: Sequence[str]) -> str:
        return " & ".join("".join(_LATEX.get(c, c) for c in text) for text in texts) + r" \\"

    lines = [f"% {SMOKE}"] if results.is_smoke else []
    names = header(results)
    columns = "l" + "r" * (len(names) - 1)
    for metric in results.table.metrics:
        title = f"{results.table.title}. {metric.title}." + f" {SMOKE}" * results.is_smoke
        lines += [r"\begin{table}", rf"\caption{{{line([title])[:-3]}}}"]
        lines += [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", line(names), r"\midrule"]
        lines += [
            *(line(row.texts) for row in rows(results, metric)),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        lines += [r"\end{table}", ""]
    return "\n".join(lines)


def html(results: Results) -> str:
    """The Markdown page as one HTML file that needs no other."""
    conditions = conditions_of(results)
    return template(TEMPLATE, words=words).render(
        table=results.table,
        smoke=SMOKE if results.is_smoke else "",
        seeds=number_of_seeds(results),
        header=header(results),
        parts=[(metric.title, rows(results, metric)) for metric in results.table.metrics],
        missing=list(results.missing),
        failed=dict(results.failed),
        conditions={name: value for name, value in conditions.items() if value},
    )
