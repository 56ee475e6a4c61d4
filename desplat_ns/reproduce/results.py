"""What a table is written from: cells, conditions, rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from desplat_ns.reproduce.cells import Cell
from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.paper import MEAN, published, rows_of
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
        texts = [done.texts[name] for done in results.done if name in done.texts]
        return [text for number, text in enumerate(texts) if text not in texts[:number]]

    records = [done.record for done in results.done]
    protocols = {
        found_scene.protocol.name: found_scene.protocol for found_scene in results.contents
    }
    return {
        "the paper's protocol": {name: protocol.said for name, protocol in protocols.items()},
        "the paper's LPIPS net": sorted({protocol.lpips_net for protocol in protocols.values()}),
        "LPIPS net": said("lpips_net"),
        "no LPIPS because": said("lpips_reason"),
        "scored": said("protocol"),
        "scenes": {
            found_scene.scene.name: {
                "data parser": " ".join(found_scene.parser),
                "training photos": content.photos,
                "test photos": content.held_out,
                "median size": f"{content.width} x {content.height}",
                "starts from": f"{content.points} points" if content.points else "random points",
            }
            for found_scene, content in results.contents.items()
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


class Entry(NamedTuple):
    """A figure in words; empty where there is none."""

    ours: str = ""
    paper: str = ""
    difference: str = ""
    """Ours less the paper's."""

    def __str__(self) -> str:
        """In one line."""
        if not self.paper:
            return self.ours or NOTHING
        return f"{self.ours} (paper {self.paper}, {self.difference})" if self.ours else self.paper


class Row(NamedTuple):
    """A row of a figure's table."""

    name: str
    entries: list[Entry]
    """One for each column."""

    @property
    def texts(self) -> list[str]:
        """Its name, and a text for each column."""
        return [self.name, *map(str, self.entries)]


def rows(results: Results, metric: Metric) -> list[Row]:
    """Ours, then those of the paper that no method stands beside."""
    table, columns = results.table, results.columns
    table_rows = []
    for method in results.methods:
        cells = [results.cell(method.name, metric, scene) for scene in columns]
        table_rows.append(Row(method.name, [_entry(cell) for cell in cells]))
    for row in results.only_in_paper:
        figures = [published(table.name, row, scene, metric.name) for scene in columns]
        if any(figure is not None for figure in figures):
            texts = ("" if figure is None else metric.text(figure) for figure in figures)
            table_rows.append(Row(f"{row}, the paper's", [Entry(paper=text) for text in texts]))
    return table_rows


def _entry(cell: Cell | None) -> Entry:
    if cell is None:
        return Entry()
    ours = cell.metric.text(cell.mean)
    if cell.paper is None or cell.difference is None:
        return Entry(ours)
    return Entry(ours, cell.metric.text(cell.paper), cell.metric.difference(cell.difference))


def header(results: Results) -> list[str]:
    """The columns' names."""
    return [
        "method",
        *("mean of scenes" if column == MEAN else column for column in results.columns),
    ]


def number_of_seeds(results: Results) -> str:
    """In words."""
    count = len(results.seeds)
    return f"Means of {count} seeds." if count > 1 else "One seed."


def words(value: Any) -> str:
    """A condition in words."""
    if isinstance(value, dict):
        return "; ".join(f"{name}: {words(entry)}" for name, entry in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(words, value))
    return str(value)
