"""A table in files: Markdown, CSV, LaTeX and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desplat_ns.files.whole import plain_errors, whole_folder
from desplat_ns.reproduce.cells import Cell
from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.paper import MEAN, published, rows_of
from desplat_ns.reproduce.protocols import LPIPS_NET
from desplat_ns.reproduce.records import Done
from desplat_ns.reproduce.scenes import Content, FoundScene
from desplat_ns.reproduce.tables import Metric, Table
from desplat_ns.studies.machine import short

SMOKE = (
    "A SMOKE RUN: few steps and small photos. It shows that everything works; the figures mean "
    "nothing and are not to be compared with anybody's."
)


NOTHING = "-"
"""Stands for a figure that there is not."""


@dataclass(frozen=True)
class Results:
    """What is written."""

    table: Table
    is_smoke: bool
    contents: Mapping[FoundScene, Content]
    methods: Sequence[Method]
    seeds: Sequence[int]
    cells: Sequence[Cell]
    done: Sequence[Done]
    missing: Sequence[str]
    """Names of scenes that are not there."""
    failed: Mapping[str, str]
    """Why a run gave no figure, by its name."""

    def cell(self, method: str, metric: Metric, scene: str) -> Cell | None:
        """None where nothing was measured."""
        place = (method, metric, scene)
        return next((c for c in self.cells if (c.method, c.metric, c.scene) == place), None)

    @property
    def columns(self) -> list[str]:
        """Names of scenes, and the mean if there is one."""
        return list(dict.fromkeys(cell.scene for cell in self.cells))

    @property
    def only_in_paper(self) -> list[str]:
        """Rows of the paper that no method stands beside."""
        ours = {method.paper for method in self.methods}
        return [] if self.is_smoke else [r for r in rows_of(self.table.name) if r not in ours]


def conditions_of(results: Results) -> dict[str, Any]:
    """All that the figures depend on."""

    def said(name: str) -> list[Any]:
        found = [done.texts[name] for done in results.done if name in done.texts]
        return [one for number, one in enumerate(found) if one not in found[:number]]

    records = [done.record for done in results.done]
    protocols = {found.protocol.name: found.protocol for found in results.contents}
    return {
        "the paper's protocol": {name: protocol.said for name, protocol in protocols.items()},
        "the paper's LPIPS net": LPIPS_NET,
        "LPIPS net": said("lpips_net"),
        "no LPIPS because": said("lpips_reason"),
        "scored": said("protocol"),
        "scenes": {
            found.scene.name: {
                "data parser": " ".join(found.parser),
                "training photos": content.photos,
                "test photos": content.held_out,
                "median size": f"{content.width} x {content.height}",
                "starts from": f"{content.points} points" if content.points else "random points",
            }
            for found, content in results.contents.items()
        },
        "methods": {method.name: method.what for method in results.methods},
        "seeds": list(results.seeds),
        "steps": sorted(
            {done.asked[done.asked.index("--max-num-iterations") + 1] for done in results.done}
        ),
        "devices": said("device") or sorted({str(record.device) for record in records}),
        "backends": sorted({str(record.backend) for record in records}),
        "versions": said("versions"),
        "commit": sorted({short(record.commit) for record in records}),
    }


def write_table(folder: Path, results: Results) -> None:
    """Write table.md, table.csv, table.tex and table.json. Raises ConfigError where it cannot."""
    texts = {
        "table.md": markdown(results),
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


def rows(results: Results, metric: Metric) -> list[list[str]]:
    """The rows of a figure's table: a name, and a text for each column."""
    table, columns = results.table, results.columns
    found = []
    for method in results.methods:
        cells = [results.cell(method.name, metric, scene) for scene in columns]
        found.append([method.name, *(_text(cell) for cell in cells)])
    for row in results.only_in_paper:
        figures = [published(table.name, row, scene, metric.name) for scene in columns]
        if any(figure is not None for figure in figures):
            texts = (NOTHING if figure is None else metric.text(figure) for figure in figures)
            found.append([f"{row}, the paper's", *texts])
    return found


def _text(cell: Cell | None) -> str:
    """Ours (the paper's, the difference)."""
    if cell is None:
        return NOTHING
    ours = cell.metric.text(cell.mean)
    if cell.paper is None or cell.difference is None:
        return ours
    paper, difference = cell.metric.text(cell.paper), cell.metric.difference(cell.difference)
    return f"{ours} (paper {paper}, {difference})"


def _header(results: Results) -> list[str]:
    return ["method", *("mean of scenes" if one == MEAN else one for one in results.columns)]


def markdown(results: Results) -> str:
    """A table for each figure, then the conditions."""
    lines = [f"# {results.table.title}", ""]
    lines += [f"**{SMOKE}**", ""] if results.is_smoke else []
    lines += [results.table.note, ""] if results.table.note and not results.is_smoke else []
    count = len(results.seeds)
    lines += [f"Means of {count} seeds." if count > 1 else "One seed.", ""]
    for metric in results.table.metrics:
        header = _header(results)
        lines += [f"## {metric.title}", "", _line(header), _line(["---"] * len(header))]
        lines += [*map(_line, rows(results, metric)), ""]
    if results.missing:
        lines += [f"Scenes that were not there: {', '.join(results.missing)}.", ""]
    lines += [f"- Failed: {name}: {' '.join(why.split())}" for name, why in results.failed.items()]
    lines += ["", "## Conditions", ""]
    lines += [
        f"- {name}: {_words(value)}" for name, value in conditions_of(results).items() if value
    ]
    return "\n".join([*lines, ""])


def _line(texts: Sequence[str]) -> str:
    return f"| {' | '.join(texts)} |"


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{name}: {_words(one)}" for name, one in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_words, value))
    return str(value)


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
    for metric in results.table.metrics:
        header = _header(results)
        columns = "l" + "r" * (len(header) - 1)
        title = f"{results.table.title}. {metric.title}." + f" {SMOKE}" * results.is_smoke
        lines += [r"\begin{table}", rf"\caption{{{line([title])[:-3]}}}"]
        lines += [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", line(header), r"\midrule"]
        lines += [*map(line, rows(results, metric)), r"\bottomrule", r"\end{tabular}"]
        lines += [r"\end{table}", ""]
    return "\n".join(lines)
