"""How time grows with the number of Gaussians and of pixels, and its plot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from desplat_ns.calibration.scenes import Scene, make_scene, tensors_of
from desplat_ns.calibration.timing import Timing, threads, time_in_turns
from lab.pixels.contenders import Contender
from lab.pixels.rasterizing import SETTINGS, forward_and_both

SIZE = (20_000, 480, 270)
"""Gaussians, width and height from which one is varied at a time."""

COUNTS = (5_000, 10_000, 20_000, 50_000, 100_000, 200_000)
WIDTHS = ((120, 68), (240, 135), (480, 270), (960, 540), (1920, 1080))

QUICK_SIZE, QUICK_STEPS = (1000, 96, 64), ((500, 1000), ((48, 32), (96, 64)))

MORE, FINER = "more of the same size", "smaller as they become more"
LARGER = "the same scene in more pixels"


@dataclass(frozen=True)
class Point:
    """Forward + backward at one size, 1 thread."""

    series: str
    count: int
    width: int
    height: int
    timing: Timing


def measure_growth(contender: Contender, rounds: int, quick: bool) -> list[Point]:
    """Forward + backward of the whole rasterizer over numbers of Gaussians, then of pixels."""
    cases = {}
    for key, scene in _scenes(quick).items():
        splats = scene.splats()
        cases[key] = forward_and_both(
            lambda splats=splats, view=scene.view: contender.rasterizer(splats, view, SETTINGS),
            tensors_of(splats),
        )[1]
    with threads(1):
        timings = time_in_turns({str(key): call for key, call in cases.items()}, rounds)
    return [
        Point(series, n, width, height, timings[str((series, n, width, height))])
        for series, n, width, height in cases
    ]


def _scenes(quick: bool) -> dict[tuple[str, int, int, int], Scene]:
    """By series, number of Gaussians, width and height."""
    size, counts, sizes = (SIZE, COUNTS, WIDTHS) if not quick else (QUICK_SIZE, *QUICK_STEPS)
    number, width, height = size
    scenes = {}
    for n in counts:
        scenes[MORE, n, width, height] = make_scene(n, width, height, sized_for=size)
        scenes[FINER, n, width, height] = make_scene(n, width, height)
    for w, h in sizes:
        scenes[LARGER, number, w, h] = make_scene(number, w, h, sized_for=size)
    return scenes


def draw_plot(points: list[Point], path: Path) -> None:
    """Two panels, logarithmic both ways, with a line of slope 1 to compare with."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _draw_series(left, points, MORE, lambda p: p.count, "o-")
    _draw_series(left, points, FINER, lambda p: p.count, "s--")
    _draw_series(right, points, LARGER, lambda p: p.width * p.height, "o-")
    left.set(xlabel=f"Gaussians (at {_sizes(points, MORE)})", ylabel="forward + backward, CPU ms")
    right.set(xlabel=f"pixels ({_counts(points, LARGER)} Gaussians)")
    for axes in (left, right):
        axes.set(xscale="log", yscale="log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(True, which="both", alpha=0.25)
        axes.legend(frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _sizes(points: list[Point], series: str) -> str:
    return ", ".join({f"{p.width} x {p.height} pixels" for p in points if p.series == series})


def _counts(points: list[Point], series: str) -> str:
    return ", ".join({f"{p.count:,}" for p in points if p.series == series})


def _draw_series(axes, points: list[Point], series: str, x_of, style: str) -> None:
    chosen = [p for p in points if p.series == series]
    xs, ys = [x_of(p) for p in chosen], [p.timing.cpu_ms for p in chosen]
    lows, highs = zip(*(p.timing.cpu_range for p in chosen), strict=True)
    axes.plot(xs, ys, style, label=series)
    axes.fill_between(xs, lows, highs, alpha=0.15)
    if series != FINER:
        axes.plot(xs, [ys[-1] * x / xs[-1] for x in xs], ":", color="gray", label="proportional")
        axes.set_ylim(0.7 * min(ys), 1.4 * max(ys))
