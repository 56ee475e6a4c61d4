"""What the trainings of a study say: medians over seeds, what pays, and what may be claimed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median, stdev

from desplat_ns.studies.plan import BASE
from desplat_ns.studies.runs import Figures, Record, Run

CostAndError = tuple[float, float]
"""The less of both the better."""

NICE_SECONDS = (5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200)
"""Training times for which the best that was reached is told."""

NEEDED = 3
"""Seeds that both sides of a claim have: `p_value` is that of so many."""

SIGNIFICANT = 0.05
"""A difference is claimed where p, corrected for the number of comparisons, is no larger."""


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


@dataclass(frozen=True)
class Measured:
    """A variant at a number of steps, or the same on its way to them."""

    variant: str
    steps: int
    """Of the run."""
    done: int
    """Steps after which it was scored."""
    seeds: tuple[int, ...]
    figures: Mapping[str, Spread]
    """By name, in the order of the seeds; what not every seed has is left out."""

    @property
    def is_final(self) -> bool:
        return self.done == self.steps

    @property
    def psnr(self) -> Spread:
        """Of right halves, dB."""
        return self.figures["psnr"]

    @property
    def psnr_by_seed(self) -> dict[int, float]:
        """dB."""
        return dict(zip(self.seeds, self.psnr.values, strict=True))

    @property
    def wall(self) -> Spread:
        """Seconds of training."""
        return self.figures["train_wall_seconds"]


def measured(runs: Sequence[Run], records: Mapping[str, Record]) -> list[Measured]:
    """All variants and lengths of which a seed was measured, in the order of the plan, each on its
    way and in the end."""
    by_cell: dict[tuple[str, int], dict[int, Mapping[int, Figures]]] = {}
    for run in runs:
        record = records.get(run.name)
        if record is not None:
            points = {int(point["step"]): point for point in record.curve}
            points[run.steps] = record.figures
            by_cell.setdefault((run.variant.name, run.steps), {})[run.seed] = points
    return [
        Measured(variant, steps, done, tuple(seeds), _spreads([p[done] for p in seeds.values()]))
        for (variant, steps), seeds in by_cell.items()
        for done in sorted(set.intersection(*(set(points) for points in seeds.values())))
    ]


def _spreads(figures: Sequence[Figures]) -> dict[str, Spread]:
    names = [name for name in figures[0] if all(name in row for row in figures)]
    return {name: Spread(tuple(float(row[name]) for row in figures)) for name in names}


def finals(points: Iterable[Measured]) -> list[Measured]:
    """Whole runs alone."""
    return [point for point in points if point.is_final]


def front(points: Sequence[CostAndError]) -> set[int]:
    """Indices of the points that no other dominates, the Pareto front.

    A point dominates another if it is no worse in either and better in one. Equal points share
    their fate. NaN is no figure: such a point is on no front and dominates none.
    """
    known = [i for i, point in enumerate(points) if not any(map(math.isnan, point))]
    indices: set[int] = set()
    least, last = math.inf, None
    for i in sorted(known, key=lambda i: points[i]):
        if points[i][1] < least or last is None or points[i] == last:
            indices.add(i)
            least, last = points[i][1], points[i]
    return indices


def on_front(points: Sequence[Measured]) -> set[int]:
    """Indices of those that no other beats: less time for as many dB, by medians."""
    return front([(point.wall.median, -point.psnr.median) for point in points])


def best_within(seconds: float | int, points: Iterable[Measured]) -> Measured | None:
    """The most dB that were reached in a training time; None if nothing was."""
    in_time = [point for point in points if point.wall.median <= seconds]
    return max(in_time, key=lambda point: point.psnr.median, default=None)


def soonest_at(decibels: float | int, points: Iterable[Measured]) -> Measured | None:
    """What reached so many dB first; None if nothing did."""
    enough = [point for point in points if point.psnr.median >= decibels]
    return min(enough, key=lambda point: point.wall.median, default=None)


def times_to_tell(points: Sequence[Measured]) -> list[int]:
    """Training times between the least and the largest that was measured, and one above."""
    walls = [point.wall.median for point in points]
    if not walls:
        return []
    times = [seconds for seconds in NICE_SECONDS if min(walls) <= seconds <= max(walls)]
    above = [seconds for seconds in NICE_SECONDS if seconds > max(walls)]
    return times + above[:1]


def decibels_to_tell(points: Sequence[Measured]) -> list[int]:
    """Whole dB that were reached, the upper six."""
    values = [point.psnr.median for point in points]
    if not values:
        return []
    return list(range(int(min(values)) + 1, int(max(values)) + 1))[-6:]


# --- what may be claimed -------------------------------------------------------------------------


def differences(point: Measured, base: Measured) -> tuple[float, ...]:
    """PSNR less the base's with the same seed, dB, of the seeds that both have: a seed's noise that
    both share is in neither."""
    ours, theirs = point.psnr_by_seed, base.psnr_by_seed
    return tuple(ours[seed] - theirs[seed] for seed in ours if seed in theirs)


def p_value(gains: Sequence[float]) -> float:
    """Of a paired t-test, two-sided: how often three differences would be as far from 0 for their
    scatter if there was none, provided that they are normally distributed.

    With two degrees of freedom Student's distribution has a closed form,
    P(|T| >= t) = 1 - t / sqrt(t^2 + 2).
    """
    assert len(gains) == NEEDED
    mean, error = fmean(gains), stdev(gains) / math.sqrt(len(gains))
    if error == 0:
        return float(mean == 0)
    t = abs(mean / error)
    return 2 / (math.hypot(t, math.sqrt(2)) * (math.hypot(t, math.sqrt(2)) + t))


def corrected(p_values: Sequence[float]) -> list[float]:
    """For their number (Holm 1979): if each that is at most q is claimed, there is a false claim
    among them in at most a share q of such studies, whatever depends on what."""
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = largest
    return adjusted


def verdicts(points: Sequence[Measured]) -> list[str]:
    """What may be said of each whole run against the base at as many steps, in their order; empty
    where there is nothing to compare it with."""
    base = {point.steps: point for point in points if point.variant == BASE}
    pairs = {
        i: differences(point, base[point.steps])
        for i, point in enumerate(points)
        if point.variant != BASE and point.steps in base
    }
    tested = [i for i, pair in pairs.items() if len(pair) == NEEDED]
    p = dict(zip(tested, corrected([p_value(pairs[i]) for i in tested]), strict=True))
    return [_verdict(pairs.get(i, ()), p.get(i)) for i in range(len(points))]


def _verdict(pair: Sequence[float], p: float | None) -> str:
    if not pair:
        return ""
    said = f"{fmean(pair):+.2f} dB"
    if p is None:
        return f"{said}, {len(pair)} of {NEEDED} seeds: no claim"
    value = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
    return f"{said}, {value}" if p <= SIGNIFICANT else f"{said}, not told apart ({value})"


def least_ratio(comparisons: int) -> float:
    """How many times its standard deviation over the seeds the clearest of several differences has
    to be, to be claimed: `p_value` solved for t, over the root of the number of seeds."""
    inside = 1 - SIGNIFICANT / max(1, comparisons)
    return inside * math.sqrt(2 / (1 - inside**2) / NEEDED)
