"""The curves of a run: what it logged while it trained."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tensorboard.backend.event_processing.event_accumulator import ScalarEvent

Points = tuple[tuple[float, float], ...]
"""(step, value), in the order of the steps."""

MOST_POINTS = 240
"""Of a curve; of more, neighbours are averaged."""

ALL_HELD_OUT = "Eval Images Metrics Dict (all images)/psnr"
TOTAL_TIME = "Train Total (time)"
"""Seconds of the training loop, logged at its end."""


@dataclass(frozen=True)
class Curve:
    """One figure over the steps."""

    label: str
    points: Points


@dataclass(frozen=True)
class Chart:
    """Curves that share their axes."""

    title: str
    curves: tuple[Curve, ...]
    is_logarithmic: bool = False


@dataclass(frozen=True)
class History:
    """What a run logged."""

    charts: tuple[Chart, ...]
    seconds: float | None
    """Of training, all sessions together; None if nothing was logged."""


CHARTS: tuple[tuple[str, Mapping[str, str], bool], ...] = (
    ("Loss, on a logarithmic scale", {"Train Loss": "what training makes small"}, True),
    (
        "PSNR, dB",
        {
            "Train Metrics Dict/psnr": "training photos, with their distractors",
            ALL_HELD_OUT: "held-out photos, by the static scene alone",
        },
        False,
    ),
    (
        "Number of Gaussians",
        {
            "Train Metrics Dict/gaussian_count": "static",
            "Train Metrics Dict/distractor_count": "distractors of all photos",
        },
        False,
    ),
)
"""Title, tags with the names of their curves, whether the scale is logarithmic."""


def read_history(files: Sequence[Path]) -> History:
    """The charts of a run and how long it took, from its event files, oldest first.

    Files that cannot be read are left out. A step that was done twice, by a run that went on from
    an earlier checkpoint, counts as it was done last.
    """
    tags = {tag for _, names, _ in CHARTS for tag in names} | {TOTAL_TIME}
    values: dict[str, dict[int, float]] = {tag: {} for tag in tags}
    seconds = []
    for path in files:
        by_tag = scalars(path, tags)
        for tag, logged in by_tag.items():
            values[tag].update({event.step: event.value for event in logged})
        if by_tag:
            seconds.append(_seconds_of(by_tag))
    charts = []
    for title, names, is_logarithmic in CHARTS:
        curves = [Curve(name, thinned(values[tag], is_logarithmic)) for tag, name in names.items()]
        drawn = tuple(curve for curve in curves if curve.points)
        if drawn:
            charts.append(Chart(title, drawn, is_logarithmic))
    return History(tuple(charts), sum(seconds) if seconds else None)


def scalars(path: Path, tags: Collection[str]) -> dict[str, Sequence[ScalarEvent]]:
    """The numbers of those tags that an event file has, in the order in which they were logged,
    each with `wall_time`, seconds since 1970, `step` and `value`.

    Ends where the file is cut off or damaged; empty if it cannot be read.
    """
    if not path.is_file():
        return {}
    from tensorboard.backend.event_processing import event_accumulator  # half a second

    whole = {event_accumulator.SCALARS: 0}  # 0: all of them, no sample
    events = event_accumulator.EventAccumulator(str(path), whole, purge_orphaned_data=False)
    try:
        events.Reload()
    except OSError:
        return {}
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"] if tag in tags}


def _seconds_of(by_tag: Mapping[str, Sequence[ScalarEvent]]) -> float:
    """Of one file's session: what its end logged, or from the first number to the last."""
    if TOTAL_TIME in by_tag:
        return by_tag[TOTAL_TIME][-1].value
    times = [event.wall_time for logged in by_tag.values() for event in logged]
    return max(times) - min(times)


def thinned(
    values: Mapping[int, float], is_logarithmic: bool = False, most: int = MOST_POINTS
) -> Points:
    """At most `most` points of (step, value): means of neighbours where there are more.

    Args:
        values: by step; what is not finite is left out.
        is_logarithmic: of a positive figure; then what is not positive is left out as well.
    """
    points = [
        (step, value)
        for step, value in sorted(values.items())
        if math.isfinite(value) and (value > 0 or not is_logarithmic)
    ]
    size = math.ceil(len(points) / most) or 1
    groups = [points[start : start + size] for start in range(0, len(points), size)]
    return tuple(
        (sum(step for step, _ in group) / len(group), sum(value for _, value in group) / len(group))
        for group in groups
    )
