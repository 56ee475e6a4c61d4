"""What the runs of a study say: medians over seeds, what pays, and which differences are real."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median, stdev
from typing import Any

from desplat_ns.studies.plan import BASE
from desplat_ns.studies.records import Key, Record
from desplat_ns.studies.runs import Run

NICE_SECONDS = (5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200)
"""Training times for which the best that was reached is told."""

NEEDED = 3
"""Seeds that both sides of a claim have: `p_value` is that of three."""

SIGNIFICANT = 0.05
"""A difference is claimed where p, corrected for the number of comparisons, is no larger."""


@dataclass(frozen=True)
class Measured:
    """A variant at a length."""

    variant: str
    steps: int
    scores: Mapping[int, Mapping[str, Any]]
    """By seed."""

    def values(self, name: str) -> list[float | int]:
        """A score of each seed that has it."""
        return [row[name] for row in self.scores.values() if name in row]

    @property
    def psnr(self) -> float | int:
        """Median over the seeds, dB."""
        return median(self.values("psnr"))

    @property
    def wall(self) -> float | int:
        """Median over the seeds, seconds of the training steps."""
        return median(self.values("train_wall_seconds"))


def measured(runs: Iterable[Run], records: Mapping[Key, Record]) -> list[Measured]:
    """What has a record of at least one seed: the base's lengths, then the other variants."""
    scores: dict[tuple[str, int], dict[int, Mapping[str, Any]]] = {}
    for run in runs:
        if (record := records.get(run.key)) is not None:
            scores.setdefault((run.variant, run.steps), {})[run.seed] = record.scores
    points = [Measured(*cell, by_seed) for cell, by_seed in scores.items()]
    return sorted(points, key=lambda point: (point.variant != BASE, point.steps))


def bought(points: Sequence[Measured]) -> list[tuple[int, Measured]]:
    """The most dB that were reached in some training times, one of them above all measured."""
    shown, number = list[tuple[int, Measured]](), 0
    for seconds in NICE_SECONDS:
        in_time = [point for point in points if point.wall <= seconds]
        if len(in_time) > number:
            shown.append((seconds, max(in_time, key=lambda point: point.psnr)))
        number = len(in_time)
    return shown


# --- which differences are real ------------------------------------------------------------------


def differences(point: Measured, base: Measured) -> list[float]:
    """PSNR less the base's with the same seed, dB, of the seeds that both have."""
    common = [seed for seed in point.scores if seed in base.scores]
    return [point.scores[seed]["psnr"] - base.scores[seed]["psnr"] for seed in common]


def p_value(gains: Sequence[float]) -> float:
    """p of a paired t-test, two-sided, of three differences.

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
    """p values for their number (Holm 1979): with a claim where the result is at most q, there is a
    false claim among them in at most a share q of such studies."""
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = largest
    return adjusted


def verdicts(points: Sequence[Measured]) -> list[str]:
    """What may be said of each point against the base at as many steps, in their order; empty
    where there is nothing to compare it with."""
    base = {point.steps: point for point in points if point.variant == BASE}
    gains = [
        [] if p.variant == BASE or p.steps not in base else differences(p, base[p.steps])
        for p in points
    ]
    tested = [i for i, pairs in enumerate(gains) if len(pairs) == NEEDED]
    p = dict(zip(tested, corrected([p_value(gains[i]) for i in tested]), strict=True))
    return [_verdict(pairs, p.get(i)) for i, pairs in enumerate(gains)]


def _verdict(gains: Sequence[float], p: float | None) -> str:
    if not gains:
        return ""
    said = f"{fmean(gains):+.2f} dB"
    if p is None:
        return f"{said}, {len(gains)} of {NEEDED} seeds: no claim"
    value = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
    return f"{said}, {value}" if p <= SIGNIFICANT else f"{said}, not told apart ({value})"
