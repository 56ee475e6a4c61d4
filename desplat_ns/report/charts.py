"""Charts as SVG, to be put into a page: colours are the page's, by class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

from desplat_ns.report.history import Chart, Points

WIDTH, HEIGHT = 420, 240
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 12, 28
"""Pixels of the SVG's own coordinates; margins hold the ticks' numbers."""

MOST_TICKS = 5
FLAT = 0.05
"""The least height of an axis, relative to its values."""


@dataclass(frozen=True)
class Axis:
    """From values to places along an axis."""

    low: float
    high: float
    start: float
    end: float
    """Coordinates of `low` and `high`."""

    def at(self, value: float) -> float:
        """The coordinate of a value."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)


def svg(chart: Chart) -> str:
    """A chart, with numbers at its ticks; the names of its curves are the page's to write."""
    points = [point for curve in chart.curves for point in curve.points]
    heights = [_height(chart, value) for _, value in points]
    low, high = _widened(min(heights), max(heights))
    last = max(step for step, _ in points) or 1.0
    steps = Axis(0.0, last, float(LEFT), float(WIDTH - RIGHT))
    values = Axis(low, high, float(HEIGHT - BOTTOM), float(TOP))
    lines = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(chart.title)} over the steps">'
    ]
    for tick in powers(low, high) if chart.is_logarithmic else ticks(low, high):
        y, text = values.at(tick), number(10**tick if chart.is_logarithmic else tick)
        lines.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        lines.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    for tick in ticks(steps.low, steps.high):
        x, anchor = steps.at(tick), "end" if steps.at(tick) > WIDTH - RIGHT - 12 else "middle"
        lines.append(f'<path class="grid" d="M{x:.1f} {HEIGHT - BOTTOM}v4"/>')
        lines.append(
            f'<text x="{x:.1f}" y="{HEIGHT - 9}" text-anchor="{anchor}">{number(tick)}</text>'
        )
    for index, curve in enumerate(chart.curves):
        lines.append(_drawn(chart, curve.points, steps, values, index))
    return "\n".join([*lines, "</svg>"])


def _drawn(chart: Chart, points: Points, steps: Axis, values: Axis, index: int) -> str:
    """A curve; few points get marks as well."""
    at = [(steps.at(step), values.at(_height(chart, value))) for step, value in points]
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in at)
    marks = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in at if len(at) <= 12)
    return f'<g class="curve{index}"><path d="M{path}"/>{marks}</g>'


def _height(chart: Chart, value: float) -> float:
    return math.log10(value) if chart.is_logarithmic else value


def _widened(low: float, high: float) -> tuple[float, float]:
    """Bounds that are apart."""
    least = max(abs(low), abs(high), 1e-6) * FLAT
    if high - low >= least:
        return low, high
    middle = (low + high) / 2
    return middle - least / 2, middle + least / 2


def ticks(low: float, high: float) -> list[float]:
    """At most `MOST_TICKS` + 1 round numbers from `low` to `high`: 1, 2 or 5 times a power of ten
    apart."""
    raw = (high - low) / MOST_TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def powers(low: float, high: float) -> list[float]:
    """Logarithms, from `low` to `high`, of 1, 2 and 5 times powers of ten; of these alone if the
    others would be too many."""
    whole = range(math.floor(low), math.ceil(high) + 1)
    for factors in ((1, 2, 5), (1,)):
        found = [power + math.log10(factor) for power in whole for factor in factors]
        inside = [one for one in found if low <= one <= high]
        if len(inside) <= MOST_TICKS + 1:
            break
    return inside


def number(value: float) -> str:
    """A tick's number: 30k, 2,500, 0.05."""
    if abs(value) >= 10_000:
        return f"{value / 1000:,g}k"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
