"""Time and memory of a training step over what grows, a panel for each series."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lab.documents import RESULTS
from lab.front.growth import SERIES, Growth, Point
from lab.front.power_law import PowerLaw, fit, is_flat

PLOTS = (RESULTS / "growth.svg", RESULTS / "growth.png")

PANEL = (2.5, 2.3)
"""Inches."""


def law_of(points: Sequence[Point]) -> PowerLaw | None:
    """The fit of a series' medians; None where a step hardly grows."""
    medians = [point.timing.cpu_ms for point in points]
    return None if is_flat(medians) else fit([point.x for point in points], medians)


def draw(growth: Growth, paths: Sequence[Path]) -> None:
    """One column for each series: CPU time above, peak memory below; logarithmic both ways."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = [name for name in SERIES if growth.of(name)]
    size = (PANEL[0] * len(names), 2 * PANEL[1])
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "growth", "font.size": 8}):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        rows = figure.subplots(2, len(names), squeeze=False)
        for name, time, memory in zip(names, *rows, strict=True):
            _draw_time(time, growth.of(name))
            _draw_memory(memory, growth.of(name))
            memory.set(xlabel=name)
        rows[0][0].set(ylabel="CPU ms a step, one thread")
        rows[1][0].set(ylabel="peak MiB")
        for path in paths:
            dateless = {"Date": None} if path.suffix == ".svg" else {"Software": None}
            figure.savefig(path, dpi=110, metadata=dateless)


def _draw_time(axes: Any, points: Sequence[Point]) -> None:
    """Medians, their ranges, and the curve through them."""
    xs, medians = [p.x for p in points], [p.timing.cpu_ms for p in points]
    lows, highs = zip(*(p.timing.cpu_range for p in points), strict=True)
    axes.fill_between(xs, lows, highs, alpha=0.15)
    law, label = law_of(points), "too flat to fit"
    if law is not None:
        many = np.geomspace(xs[0], xs[-1], 50)
        axes.plot(many, law.constant + law.factor * many**law.exponent, lw=1)
        label = f"exponent {law.exponent:.2f}"
    axes.plot(xs, medians, "o", color="C0", ms=4, label=label)
    axes.set(ylim=(0.5 * min(lows), 2 * max(highs)))
    _logarithmic(axes)


def _draw_memory(axes: Any, points: Sequence[Point]) -> None:
    """What was measured, and parameters with their moments alone."""
    known = [p for p in points if p.peak_mib is not None]
    if known:
        axes.plot([p.x for p in known], [p.peak_mib for p in known], "o-", ms=4, label="measured")
    trained = [p.trained_bytes / 2**20 for p in points]
    axes.plot([p.x for p in points], trained, "--", color="gray", label="parameters, moments")
    _logarithmic(axes)


def _logarithmic(axes: Any) -> None:
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    axes.set(xscale="log", yscale="log")
    axes.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.grid(True, which="major", alpha=0.25)
    axes.legend(frameon=False, fontsize=7)
