"""What the trainings of a study say: medians over seeds, what pays, and what may be claimed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from desplat_ns.studies.grid.records import Figures, Records
from desplat_ns.studies.grid.runs import Run
from desplat_ns.studies.tradeoff import pareto
from desplat_ns.studies.tradeoff.plan import BASE, SEEDS

NICE_SECONDS = (5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200)
"""Training times for which the best that was reached is told."""


@dataclass(frozen=True)
class Spread:
    """A figure of several seeds."""

    values: tuple[float, ...]

    @property
    def median(self) -> float:
        return median(self.values)

    @property
    def least(self) -> float:
        return min(self.values)

    @property
    def most(self) -> float:
        return max(self.values)

    def overlaps(self, other: Spread) -> bool:
        """Whether the two ranges have a value in common."""
        return self.least <= other.most and other.least <= self.most


@dataclass(frozen=True)
class Measured:
    """A setting at a number of steps, or the same on its way to them."""

    setting: str
    steps: int
    """Of the run."""
    done: int
    """Steps after which it was scored."""
    figures: Mapping[str, Spread]
    """By name; what not every seed has is left out."""

    @property
    def is_final(self) -> bool:
        return self.done == self.steps

    @property
    def seeds(self) -> int:
        return len(self.psnr.values)

    @property
    def psnr(self) -> Spread:
        """Of right halves, dB."""
        return self.figures["psnr"]

    @property
    def wall(self) -> Spread:
        """Seconds of training."""
        return self.figures["train_wall_seconds"]


def measured(runs: Sequence[Run], records: Records) -> list[Measured]:
    """All settings and lengths of which a seed was measured, in the order of the plan, each on its
    way and in the end."""
    by_cell: dict[tuple[str, int], list[Mapping[int, Figures]]] = {}
    for run in runs:
        record = records.get(run.name)
        if record is not None:
            points = {int(point["step"]): point for point in record.curve}
            points[run.steps] = record.figures
            by_cell.setdefault((run.setting, run.steps), []).append(points)
    return [
        Measured(setting, steps, done, _spreads([points[done] for points in seeds]))
        for (setting, steps), seeds in by_cell.items()
        for done in sorted(set.intersection(*(set(points) for points in seeds)))
    ]


def _spreads(figures: Sequence[Figures]) -> dict[str, Spread]:
    names = [name for name in figures[0] if all(name in one for one in figures)]
    return {name: Spread(tuple(float(one[name]) for one in figures)) for name in names}


def finals(found: Iterable[Measured]) -> list[Measured]:
    """Whole runs alone."""
    return [one for one in found if one.is_final]


def on_front(found: Sequence[Measured]) -> set[int]:
    """Indices of those that no other beats: less time for as many dB, by medians."""
    return pareto.front([(one.wall.median, -one.psnr.median) for one in found])


def best_within(seconds: float | int, found: Iterable[Measured]) -> Measured | None:
    """The most dB that were reached in a training time; None if nothing was."""
    in_time = [one for one in found if one.wall.median <= seconds]
    return max(in_time, key=lambda one: one.psnr.median, default=None)


def soonest_at(decibels: float | int, found: Iterable[Measured]) -> Measured | None:
    """What reached so many dB first; None if nothing did."""
    enough = [one for one in found if one.psnr.median >= decibels]
    return min(enough, key=lambda one: one.wall.median, default=None)


def times_to_tell(found: Sequence[Measured]) -> list[int]:
    """Training times between the least and the largest that was measured, and one above."""
    walls = [one.wall.median for one in found]
    if not walls:
        return []
    told = [seconds for seconds in NICE_SECONDS if min(walls) <= seconds <= max(walls)]
    above = [seconds for seconds in NICE_SECONDS if seconds > max(walls)]
    return told + above[:1]


def decibels_to_tell(found: Sequence[Measured]) -> list[int]:
    """Whole dB that were reached, the upper six."""
    values = [one.psnr.median for one in found]
    if not values:
        return []
    return list(range(int(min(values)) + 1, int(max(values)) + 1))[-6:]


def verdict(one: Measured, base: Measured | None) -> str:
    """What may be said of a setting against the base at as many steps."""
    if base is None or one.setting == BASE:
        return ""
    difference = one.psnr.median - base.psnr.median
    if min(one.seeds, base.seeds) < len(SEEDS):
        return f"{difference:+.2f} dB, no claim"
    if one.psnr.overlaps(base.psnr):
        return f"{difference:+.2f} dB, within the spread"
    return f"{difference:+.2f} dB, with every seed"
