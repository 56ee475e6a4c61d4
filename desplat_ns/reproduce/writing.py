"""A table in files: means over seeds, the paper's figures beside them, and the conditions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from desplat_ns.files.whole import plain_errors, whole_folder
from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.paper import MEAN, published, rows_of
from desplat_ns.reproduce.protocols import LPIPS_NET
from desplat_ns.reproduce.tables import Metric
from desplat_ns.studies.machine import short
from desplat_ns.studies.records import markdown_table

if TYPE_CHECKING:
    from desplat_ns.reproduce.grid import Grid

SMOKE = (
    "A SMOKE RUN: few steps and small photos. It shows that everything works; the figures mean "
    "nothing and are not to be compared with anybody's."
)

NOTHING = "-"
"""Stands for a figure that there is not."""

Cell = dict[str, Any]
"""A figure of a method on a scene or on `MEAN`: `scene`, `method`, `metric`, `values` (one for each
seed that is done), `mean`, `paper`, `difference` (ours less the paper's). The last two are None
where the paper has no figure, and in a smoke run."""


def cells_of(grid: Grid) -> list[Cell]:
    """All figures that there are, and their means where a seed has all scenes of the table."""
    metrics, methods = grid.request.table.metrics, grid.request.methods
    return [
        cell for metric in metrics for method in methods for cell in _cells(grid, metric, method)
    ]


def _cells(grid: Grid, metric: Metric, method: Method) -> list[Cell]:
    table, scenes = grid.request.table, [found.scene.name for found in grid.contents]
    columns: dict[str, list[float | None]] = {name: [] for name in (*scenes, MEAN)}
    is_smoke = grid.request.smoke is not None
    is_whole = is_smoke or set(scenes) == {scene.name for scene in table.scenes}
    for seed in grid.seeds:
        records = [grid.records.get(grid.runs[name, method.name, seed].key) for name in scenes]
        values = [None if record is None else metric.of(record.scores) for record in records]
        known = [value for value in values if value is not None]
        has_mean = is_whole and len(known) == len(scenes) > 1
        values.append(fmean(known) if has_mean else None)
        for column, value in zip(columns.values(), values, strict=True):
            column.append(value)
    cells = []
    for name, column in columns.items():
        known = [value for value in column if value is not None]
        if known:
            paper = None if is_smoke else published(table.name, method.paper, name, metric.name)
            mean = fmean(known)
            cell = {"scene": name, "method": method.name, "metric": metric.name, "values": known}
            difference = None if paper is None else mean - paper
            cells.append(cell | {"mean": mean, "paper": paper, "difference": difference})
    return cells


def rows(
    grid: Grid, metric: Metric, columns: Sequence[str], cells: Sequence[Cell]
) -> list[list[str]]:
    """A metric's rows in words: ours, then those of the paper that no method stands beside."""
    table, methods = grid.request.table, grid.request.methods
    found = {(c["method"], c["scene"]): c for c in cells if c["metric"] == metric.name}
    ours = [
        [method.name, *(_words(metric, found.get((method.name, name))) for name in columns)]
        for method in methods
    ]
    beside = {method.paper for method in methods}
    theirs = []
    for row in [] if grid.request.smoke else rows_of(table.name):
        figures = [published(table.name, row, name, metric.name) for name in columns]
        if row not in beside and figures != [None] * len(columns):
            texts = (NOTHING if figure is None else metric.text(figure) for figure in figures)
            theirs.append([f"{row}, the paper's", *texts])
    return ours + theirs


def _words(metric: Metric, cell: Cell | None) -> str:
    if cell is None:
        return NOTHING
    text, paper = metric.text(cell["mean"]), cell["paper"]
    if paper is None:
        return text
    return f"{text} (paper {metric.text(paper)}, {metric.text(cell['difference'], '+')})"


def write_table(folder: Path, grid: Grid) -> None:
    """Write table.md and table.json. Raises ConfigError where it cannot."""
    cells, conditions = cells_of(grid), conditions_of(grid)
    content = {"table": grid.request.table.name, "smoke": grid.request.smoke is not None}
    content |= {"cells": cells, "conditions": conditions}
    content |= {"missing scenes": grid.missing, "failed": grid.failed}
    with plain_errors(folder), whole_folder(folder) as draft:
        (draft / "table.md").write_text(markdown(grid, cells, conditions), "utf8")
        (draft / "table.json").write_text(json.dumps(content, indent=1) + "\n", "utf8")


def markdown(grid: Grid, cells: Sequence[Cell], conditions: dict[str, Any]) -> str:
    """A table for each metric, then the conditions."""
    table, seeds = grid.request.table, len(grid.seeds)
    parts = [f"# {table.title}", f"**{SMOKE}**" if grid.request.smoke else table.note]
    parts.append(f"Means of {seeds} seeds." if seeds > 1 else "One seed.")
    columns = list(dict.fromkeys(cell["scene"] for cell in cells))
    head = ["method", *("mean of scenes" if name == MEAN else name for name in columns)]
    for metric in table.metrics:
        body = rows(grid, metric, columns, cells)
        parts += [f"## {metric.title}", markdown_table(head, body, "l" * len(head))]
    if grid.missing:
        parts.append(f"Scenes that were not there: {', '.join(grid.missing)}.")
    parts += [f"- Failed: {name}: {' '.join(why.split())}" for name, why in grid.failed.items()]
    lines = (f"- {name}: {_text(value)}" for name, value in conditions.items() if value)
    return "\n\n".join([*filter(None, parts), "## Conditions", "\n".join(lines), ""])


def conditions_of(grid: Grid) -> dict[str, Any]:
    """All that the figures depend on."""
    keys = [run.key for run in grid.runs.values()]
    done = [grid.records[key] for key in keys if key in grid.records]

    def said(name: str) -> list[str]:
        return sorted({str(record.scores[name]) for record in done if name in record.scores})

    protocols = {found.protocol.name: found.protocol for found in grid.contents}
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
            for found, content in grid.contents.items()
        },
        "methods": {method.name: method.what for method in grid.request.methods},
        "seeds": list(grid.seeds),
        "steps": sorted({run.steps for run in grid.runs.values()}),
        "devices": sorted({record.device for record in done}),
        "backends": said("backend"),
        "versions": said("versions"),
        "commit": sorted({short(record.commit) for record in done}),
    }


def _text(value: Any) -> str:
    """A condition in words."""
    if isinstance(value, dict):
        return "; ".join(f"{name}: {_text(entry)}" for name, entry in value.items())
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)
