"""How the time and the memory of a training step grow, and what with.

    python -m lab.front.growth        (half an hour: docs/records/growth.json, plots, page)

One thread, CPU time. One number is varied in each series, the others stay.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from desplat_ns.calibration.timing import Timing, threads, time_in_turns
from desplat_ns.studies.machine import code_version, describe_machine
from lab.documents import RECORDS
from lab.front.growth_memory import measure_peak
from lab.front.whole_step import Size, WholeStep

FILE = RECORDS / "growth.json"
"""The records."""

SMALL = Size(views=8, static=5_000, width=160, height=120, distractors=200)
"""Where little else hides what grows."""
MIDDLE = Size(views=8, static=20_000, width=480, height=270, distractors=200)

VIEWS, PIXELS, STATIC = "views", "pixels", "static Gaussians"
DRAWN, OTHERS = "distractors of the drawn view", "distractors of all views"

SERIES: dict[str, tuple[Size, ...]] = {
    VIEWS: tuple(replace(SMALL, views=n) for n in (8, 100, 400, 1700)),
    PIXELS: tuple(
        replace(MIDDLE, width=w, height=h)
        for w, h in ((120, 68), (240, 135), (480, 270), (960, 540), (1920, 1080))
    ),
    STATIC: tuple(
        replace(MIDDLE, static=n) for n in (5_000, 10_000, 20_000, 50_000, 100_000, 200_000)
    ),
    DRAWN: tuple(replace(SMALL, distractors=n) for n in (100, 300, 1_000, 3_000, 10_000)),
    OTHERS: tuple(replace(SMALL, views=100, others=n) for n in (30, 100, 300, 1_000, 3_000)),
}
"""What is varied; Gaussians are smaller as they become more, but in more pixels they stay."""


@dataclass(frozen=True)
class Point:
    """A step that was measured."""

    series: str
    size: Size
    cpu_ms: tuple[float, ...]
    """Of every counted step."""
    trained_bytes: int
    """Parameters and Adam's moments of all of them."""
    peak_mib: float | None
    """Above what the process held before the model was built; None where it is not known."""

    @property
    def x(self) -> int:
        """What is varied."""
        return {
            VIEWS: self.size.views,
            PIXELS: self.size.pixels,
            STATIC: self.size.static,
            DRAWN: self.size.distractors,
            OTHERS: self.size.all_distractors,
        }[self.series]

    @property
    def timing(self) -> Timing:
        """With its median and range."""
        return Timing(cpu=list(self.cpu_ms))


@dataclass(frozen=True)
class Growth:
    """All that was measured."""

    machine: dict[str, str]
    commit: str
    points: tuple[Point, ...]

    def of(self, series: str) -> list[Point]:
        """The points of one series."""
        return [point for point in self.points if point.series == series]


def like_of(series: str) -> Size | None:
    """Whose Gaussians a series has; None for each size its own."""
    return MIDDLE if series == PIXELS else None


def measure_series(series: str, sizes: tuple[Size, ...], rounds: int) -> list[Point]:
    """Time the steps of a series in turns, and measure the memory of each by itself."""
    like = like_of(series)
    peaks = {size: measure_peak(size, like) for size in sizes}
    with threads(1):
        steps = {size: WholeStep(size, like) for size in sizes}
        timings = time_in_turns({str(size): step for size, step in steps.items()}, rounds)
    return [
        Point(
            series,
            size,
            tuple(round(ms, 3) for ms in timings[str(size)].cpu),
            step.model.trained_bytes(),
            peaks[size],
        )
        for size, step in steps.items()
    ]


def measure(series: Mapping[str, tuple[Size, ...]], rounds: int) -> Growth:
    """All series, one after the other."""
    machine, commit, points = describe_machine(), code_version(), []
    for name, sizes in series.items():
        print(f"{name} ...", flush=True)
        points += measure_series(name, sizes, rounds)
    return Growth(machine, commit, tuple(points))


def save(growth: Growth, path: Path = FILE) -> None:
    """Write the records, a line for each point."""
    points = ",\n".join(json.dumps(asdict(point)) for point in growth.points)
    head = f'"machine": {json.dumps(growth.machine)},\n"commit": {json.dumps(growth.commit)}'
    path.write_text(f'{{\n{head},\n"points": [\n{points}\n]\n}}\n', "utf8")


def load(path: Path = FILE) -> Growth:
    """Read the records."""
    content = json.loads(path.read_text("utf8"))
    points = [
        Point(**point | {"size": Size(**point["size"]), "cpu_ms": tuple(point["cpu_ms"])})
        for point in content["points"]
    ]
    return Growth(content["machine"], content["commit"], tuple(points))


def main() -> None:
    """Entry point."""
    from lab.front.growth_plot import PLOTS, draw
    from lab.front.report import write_report

    parser = argparse.ArgumentParser(prog="python -m lab.front.growth")
    parser.add_argument("--rounds", type=int, default=9, help="turns of each size (%(default)s)")
    parser.add_argument("--report", action="store_true", help="measure nothing, write the page")
    options = parser.parse_args()
    if not options.report:
        save(measure(SERIES, options.rounds))
    draw(load(), PLOTS)
    print(f"written: {write_report()}")


if __name__ == "__main__":
    main()
