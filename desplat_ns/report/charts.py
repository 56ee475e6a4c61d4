"""Charts of a run as SVG in the page's own colours, light or dark."""

from __future__ import annotations

import re

from desplat_ns.files.pages import chart as new_chart
from desplat_ns.files.pages import inline_svg, plain_logarithmic, svg_of
from desplat_ns.report.history import Chart

SIZE = (4.8, 2.8)
"""Inches, where letters have 10 points."""

COLOURS = {"#0b6e99": "var(--accent)", "#c2571a": "var(--second)", "#000000": "var(--soft)"}
"""Of the first curve, the second, and the axes: as drawn, and as the page calls them."""

FEW = 12
"""Points of a curve, up to which each has a mark."""


def svg(chart: Chart) -> str:
    """A chart over the steps; the names of its curves are the page's to write."""
    with new_chart(chart.title, SIZE) as axes:
        if chart.is_logarithmic:
            plain_logarithmic(axes.yaxis)
        else:
            axes.yaxis.set_major_formatter("{x:,.10g}")
        axes.xaxis.set_major_formatter("{x:,.10g}")
        for curve, colour in zip(chart.curves, COLOURS, strict=False):
            mark = "o" if len(curve.points) <= FEW else ""
            steps, values = zip(*curve.points, strict=True)
            axes.plot(steps, values, color=colour, marker=mark, markersize=4)
        axes.locator_params(axis="x", nbins=5)
        axes.figure.set_facecolor("none")
        axes.set_facecolor("none")
        drawn = inline_svg(svg_of(axes))
    drawn = re.sub(r' clip-path="[^"]*"', "", drawn)  # all curves lie within the axes
    return re.sub("|".join(COLOURS), lambda match: COLOURS[match[0]], drawn)
