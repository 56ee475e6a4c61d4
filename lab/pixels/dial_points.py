"""What a study of the dials finds: points of time and error, their fronts, and what it left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from desplat_ns.studies.summary import CostAndError, front

RASTERIZING, ANTIALIASING, APPEARANCE = "rasterizing", "antialiasing", "appearance MLP"
"""Groups: the points of one have the same work and the same truth, and one front."""


@dataclass(frozen=True)
class Label:
    """Where a point belongs."""

    group: str
    dial: str
    value: str
    backend: str

    def __str__(self) -> str:
        return f"{self.group}: {self.backend}, {self.dial} {self.value}"


@dataclass(frozen=True)
class DialPoint(Label):
    """One setting's times and errors."""

    is_default: bool
    """Today's default on this machine: one point of each group."""
    clock: str
    """What the times are of: "CPU" time of the process, on one thread, or "wall" time on a GPU."""
    forward_ms: float
    """Median of `calls` calls, as `both_ms`."""
    both_ms: float
    """Forward + backward."""
    forward_range_ms: tuple[float, float]
    """The least and the largest: what else the machine did is in it."""
    both_range_ms: tuple[float, float]
    calls: int
    picture_error: float
    """RMSE of colours from 0 to 1."""
    picture_psnr: float
    """dB."""
    gradient_error: float
    """Relative, by norms, of the parameter where it is largest: see `dial_errors.DialErrors`."""
    worst_gradient: str
    """That parameter."""
    is_on_picture_front: bool = False
    """By (forward_ms, picture_error), in its group."""
    is_on_gradient_front: bool = False
    """By (both_ms, gradient_error)."""
    forward_excess: float = 1.0
    """forward_ms over the least with which a picture as exact is to be had: `excess`."""
    both_excess: float = 1.0
    """both_ms over the least with which gradients as exact are to be had."""


@dataclass(frozen=True)
class LeftOut(Label):
    """What was not measured."""

    reason: str


@dataclass(frozen=True)
class DialStudy:
    """All of it, of one scene; `dataclasses.asdict` makes JSON of it."""

    scene: str
    seconds: float
    """That it took, once kernels were compiled."""
    points: list[DialPoint]
    left_out: list[LeftOut]


@dataclass(frozen=True)
class Fronts:
    """Indices of the points that no other of their group dominates."""

    picture: set[int]
    """By (forward_ms, picture_error)."""
    gradient: set[int]
    """By (both_ms, gradient_error)."""


def excess(points: Sequence[CostAndError]) -> list[float]:
    """Each point's cost over the least cost at which its error, or a smaller one, is to be had.

    1 on the front. Times are noisy, and which of two close points is on the front may change from
    run to run: 1.02 says that nothing as exact is cheaper by more than 2%. NaN where a figure is.
    """
    return [
        cost / min((c for c, e in points if e <= error and not math.isnan(c)), default=math.nan)
        for cost, error in points
    ]


def front_of(points: Sequence[DialPoint]) -> Fronts:
    """The fronts of all groups together, each group by itself."""
    fronts = Fronts(set(), set())
    for members in _by_group(points):
        of_group = [points[i] for i in members]
        fronts.picture.update(members[i] for i in front(_pictures(of_group)))
        fronts.gradient.update(members[i] for i in front(_gradients(of_group)))
    return fronts


def marked(points: Sequence[DialPoint]) -> list[DialPoint]:
    """The same points, with their places relative to the fronts."""
    fronts, placed = front_of(points), list(points)
    for members in _by_group(points):
        of_group = [points[i] for i in members]
        excesses = (excess(_pictures(of_group)), excess(_gradients(of_group)))
        for i, forward, both in zip(members, *excesses, strict=True):
            placed[i] = replace(
                points[i],
                is_on_picture_front=i in fronts.picture,
                is_on_gradient_front=i in fronts.gradient,
                forward_excess=forward,
                both_excess=both,
            )
    return placed


def _by_group(points: Sequence[DialPoint]) -> list[list[int]]:
    groups: dict[str, list[int]] = {}
    for i, point in enumerate(points):
        groups.setdefault(point.group, []).append(i)
    return list(groups.values())


def _pictures(points: Sequence[DialPoint]) -> list[CostAndError]:
    return [(p.forward_ms, p.picture_error) for p in points]


def _gradients(points: Sequence[DialPoint]) -> list[CostAndError]:
    return [(p.both_ms, p.gradient_error) for p in points]
