"""What the runs of a table say: means over seeds, and the paper's figures beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean

from desplat_ns.reproduce.methods import Method
from desplat_ns.reproduce.paper import MEAN, published
from desplat_ns.reproduce.tables import Metric, Table
from desplat_ns.studies.runs import Figures

Lookup = Callable[[str, str, int], Figures | None]
"""The figures of a scene, a method and a seed."""


@dataclass(frozen=True)
class Cell:
    """A figure of a method on a scene."""

    scene: str
    """Its name, or `MEAN`."""
    method: str
    metric: Metric
    values: tuple[float, ...]
    """One for each seed that is done."""
    paper: float | None

    @property
    def mean(self) -> float:
        return fmean(self.values)

    @property
    def difference(self) -> float | None:
        """Ours less the paper's; None where the paper has no figure."""
        return None if self.paper is None else self.mean - self.paper


def cells_of(
    table: Table,
    scenes: Sequence[str],
    methods: Sequence[Method],
    seeds: Sequence[int],
    lookup: Lookup,
    is_smoke: bool,
) -> list[Cell]:
    """All figures that there are, and their means where a seed has all scenes of the table.

    Args:
        scenes: names of those that were run.
        is_smoke: nothing stands beside the paper's figures then.
    """
    whole = is_smoke or set(scenes) == {scene.name for scene in table.scenes}

    def cell(scene: str, method: Method, metric: Metric, values: Iterable[float | None]):
        row = method.paper
        paper = None if is_smoke else published(table.name, row, scene, metric.name)
        known = tuple(value for value in values if value is not None)
        return Cell(scene, method.name, metric, known, paper)

    cells = []
    for metric in table.metrics:
        for method in methods:
            by_seed = [
                [_value(metric, lookup(s, method.name, seed)) for s in scenes] for seed in seeds
            ]
            for index, scene in enumerate(scenes):
                cells.append(cell(scene, method, metric, (figures[index] for figures in by_seed)))
            if whole and len(scenes) > 1:
                cells.append(cell(MEAN, method, metric, map(_mean, by_seed)))
    return [entry for entry in cells if entry.values]


def _value(metric: Metric, figures: Figures | None) -> float | None:
    return None if figures is None else metric.of(figures)


def _mean(values: Sequence[float | None]) -> float | None:
    """None unless all are known."""
    known = [value for value in values if value is not None]
    return fmean(known) if len(known) == len(values) else None
