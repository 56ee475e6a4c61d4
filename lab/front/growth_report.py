"""Tables of how a step grows, and what follows for a capture of 1,700 photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from desplat_ns.studies.machine import short
from lab.front.growth import DRAWN, OTHERS, PIXELS, SERIES, STATIC, VIEWS, Growth, Point
from lab.front.growth_plot import law_of
from lab.front.power_law import exponent_range, fit, upper_slope
from lab.grid.tables import table
from lab.performance.tables import with_range

HELD = {
    VIEWS: "5,000 static, 160 x 120, 200 distractors in each view",
    PIXELS: "20,000 static, 8 views, 200 distractors in each",
    STATIC: "480 x 270, 8 views, 200 distractors in each",
    DRAWN: "5,000 static, 160 x 120, 8 views with as many each",
    OTHERS: "5,000 static, 160 x 120, 100 views, 200 in the drawn one",
}
"""What stays the same in each series."""

PHOTOS, STEPS = 1_700, 200_000
"""Of the capture that is worked out, and of the paper's run of it."""
WIDTH, HEIGHT = 1024, 768
LEFT = 400
"""Distractors that `desplat` leaves a photo: 220 to 450 in docs/records/separation.json and
docs/records/photo_tourism.json."""
SPREAD = 1_000
"""Distractors that a photo starts with in `desplat-paper`."""
MILLION = 1_000_000


def time_table(growth: Growth) -> str:
    """A row for each series: what a step takes at both ends, and how it grows in between."""
    head = ["varied", "the others", "from - to", "CPU ms, first", "CPU ms, last"]
    rows = []
    for name in SERIES:
        points = growth.of(name)
        if points:
            ends = [f"{point.x:,}" for point in (points[0], points[-1])]
            times = [with_range(point.timing) for point in (points[0], points[-1])]
            rows.append([name, HELD[name], " - ".join(ends), *times, *_exponents(points)])
    return table([*head, "exponent", "between the last two"], rows)


def _exponents(points: Sequence[Point]) -> tuple[str, str]:
    """The fitted exponent with what noise allows, and the slope between the last two points."""
    xs, medians = [p.x for p in points], [p.timing.cpu_ms for p in points]
    slope, law = f"{upper_slope(xs, medians):.2f}", law_of(points)
    if law is None:
        return f"too flat to fit ({medians[-1] / medians[0] - 1:+.0%})", slope
    low, high = exponent_range(xs, [p.cpu_ms for p in points])
    return f"{law.exponent:.2f} ({low:.2f} - {high:.2f})", slope


def bytes_per(points: Sequence[Point], measured: bool) -> float | None:
    """Slope of the straight line through a series' memory: bytes for one more of what is varied.

    Args:
        measured: the peak; else parameters with their moments. None where it was not measured.
    """
    peaks = [p.peak_mib for p in points]
    sizes: list[float] = [p.trained_bytes for p in points]
    if measured:
        if None in peaks:
            return None
        sizes = [2**20 * peak for peak in peaks if peak is not None]
    return float(np.polyfit([p.x for p in points], sizes, 1)[0])


def memory_table(growth: Growth) -> str:
    """A row for each series: bytes for one more."""
    rows = []
    for name in SERIES:
        points = growth.of(name)
        if points:
            slopes = [bytes_per(points, measured) for measured in (False, True)]
            cells = ["n/a" if slope is None else f"{abs(slope):,.0f}" for slope in slopes]
            peaks = [p.peak_mib for p in (points[0], points[-1])]
            ends = ["n/a" if peak is None else f"{peak:,.0f}" for peak in peaks]
            rows.append([name, *cells, " - ".join(ends), _peak_exponent(points)])
    head = ["one more of", "parameters, moments: bytes", "peak: bytes", "peak, MiB"]
    return table([*head, "its exponent"], rows)


def _peak_exponent(points: Sequence[Point]) -> str:
    """Of the power law through the peaks, each measured once."""
    peaks = [p.peak_mib for p in points if p.peak_mib is not None]
    if len(peaks) < len(points):
        return "n/a"
    return f"{fit([p.x for p in points], peaks).exponent:.2f}"


@dataclass(frozen=True)
class OnPaper:
    """Slopes, and what they come to for a capture of `PHOTOS`."""

    static_bytes: float
    distractor_bytes: float
    view_bytes: float
    """Of a view besides its distractors' values: what it costs to keep a view at all."""
    view_ms: float
    """CPU milliseconds of a step for one view more."""

    @classmethod
    def of(cls, growth: Growth) -> OnPaper:
        """Take the slopes from what was measured."""
        views, others = growth.of(VIEWS), growth.of(OTHERS)
        distractor = _known(bytes_per(others, measured=False))
        per_view = distractor * views[0].size.distractors
        measured = bytes_per(views, measured=True)
        slope = np.polyfit([p.x for p in views], [p.timing.cpu_ms for p in views], 1)[0]
        return cls(
            _known(bytes_per(growth.of(STATIC), measured=False)),
            distractor,
            0.0 if measured is None else max(0.0, measured - per_view),
            float(slope),
        )

    def texts(self) -> dict[str, str]:
        """By their names in the template."""
        photo = 3 * WIDTH * HEIGHT
        distractors = {n: PHOTOS * n * self.distractor_bytes for n in (LEFT, SPREAD)}
        return {
            "static_bytes": f"{self.static_bytes:.0f}",
            "static_gigabytes": f"{self.static_bytes * MILLION / 1e9:.2f}",
            "distractor_bytes": f"{self.distractor_bytes:.0f}",
            "left_megabytes": f"{distractors[LEFT] / 1e6:.0f}",
            "spread_megabytes": f"{distractors[SPREAD] / 1e6:.0f}",
            "view_kilobytes": f"{self.view_bytes / 1e3:.0f}",
            "view_megabytes": f"{PHOTOS * self.view_bytes / 1e6:.0f}",
            "photo_megabytes": f"{photo / 1e6:.1f}",
            "photos_gigabytes": f"{PHOTOS * photo / 1e9:.1f}",
            "visits": f"{STEPS / PHOTOS:.0f}",
            "view_ms": f"{PHOTOS * self.view_ms:+.1f}",
        }


def _known(slope: float | None) -> float:
    assert slope is not None, "counted, not measured"
    return slope


def growth_texts(growth: Growth) -> dict[str, str]:
    """All that the template asks for, by name."""
    machine = growth.machine
    return {
        "growth_times": time_table(growth),
        "growth_memory": memory_table(growth),
        "growth_made_by": (
            f"{machine['Processor']}, load {machine['Load before the run']} before the run, "
            f"commit {short(growth.commit)}, {machine['Date']}"
        ),
        **OnPaper.of(growth).texts(),
    }
