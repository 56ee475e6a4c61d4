"""What a study's tables show: medians over the seeds, with the records that they are of."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from lab.grid.records import Records
from lab.grid.runs import Run
from lab.grid.sources import Cell, Measured, sourced_table

NOT_YET = "not measured"

Key = tuple[str, str, int, int]
"""Setting, scene, downscale and steps of runs that differ in nothing but their seed."""


class Figures:
    """Medians over the seeds that were measured, and their records."""

    def __init__(self, records: Records, seeds: Sequence[int]):
        self.records, self.seeds = records, seeds

    def by_seed(self, key: Key) -> dict[int, Measured]:
        """The seeds that were measured."""
        runs = {seed: Run(*key, seed) for seed in self.seeds}
        return {
            seed: (run, self.records[run.name])
            for seed, run in runs.items()
            if run.name in self.records
        }

    def together(self, figure: str, *keys: Key) -> tuple[list[tuple[float, ...]], list[Measured]]:
        """A figure of several runs, for each seed of which all have it; and their records."""
        by_key = [self.by_seed(key) for key in keys]
        seeds = [
            seed
            for seed in self.seeds
            if all(seed in recorded and figure in recorded[seed][1].figures for recorded in by_key)
        ]
        values = [
            tuple(float(recorded[seed][1].figures[figure]) for recorded in by_key) for seed in seeds
        ]
        return values, [recorded[seed] for seed in seeds for recorded in by_key]

    def cell(self, key: Key, figure: str, form: str) -> Cell:
        """Median and range of a figure."""
        values, measured = self.together(figure, key)
        return Cell(spread([value for (value,) in values], form), tuple(measured))

    def has(self, key: Key) -> bool:
        """Whether a run was measured with any seed."""
        return bool(self.by_seed(key))

    def table(self, head: list[str], rows: list[list[str | Cell]]) -> str:
        """A table that says what its records are of."""
        return sourced_table(head, rows) if rows else f"*{NOT_YET} yet*"


def spread(values: list[float], form: str) -> str:
    """Median, and in brackets the least and the largest of several."""
    if not values:
        return ""
    text = format(median(values), form)
    if len(values) == 1:
        return text
    return f"{text} ({format(min(values), form)} - {format(max(values), form)})"
