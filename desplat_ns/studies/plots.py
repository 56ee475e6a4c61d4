"""The plots of a report, each as SVG and PNG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from desplat_ns.files.pages import chart, plain_logarithmic, svg_of
from desplat_ns.studies.plan import BASE
from desplat_ns.studies.summary import Measured, finals

SIZE = (6.6, 4.4)
"""Inches: one panel, so that it can be read on a telephone."""

COLOURS = ("#0b6e99", "#c4452d", "#4f8a3b", "#8b5fbf", "#d08a1d", "#2a9d8f", "#a23b72", "#6b705c")
MARKERS = "osD^vPXhd"
MORE = {"ssim": "SSIM", "lpips": "LPIPS", "mask_iou": "mask IoU"}
"""Figures of a run beside its PSNR, in words."""


@contextmanager
def _figure(folder: Path, name: str, label: str) -> Iterator[Any]:
    """Axes over the training time whose picture is written as NAME.svg and NAME.png."""
    with chart(name, SIZE) as axes:
        axes.set(xlabel="training time, s of wall time", ylabel=label)
        plain_logarithmic(axes.xaxis)
        yield axes
        (folder / f"{name}.svg").write_text(svg_of(axes), "utf8")
        axes.figure.savefig(folder / f"{name}.png", dpi=130, metadata={"Software": None})


def draw_all(folder: Path, points: Sequence[Measured]) -> list[str]:
    """Draw what there is; the names of the plots."""
    return [draw_training(folder, points), *draw_other_figures(folder, points)] if points else []


def draw_training(folder: Path, points: Sequence[Measured]) -> str:
    """PSNR against training time: every variant with its spread, the base's lengths as a line."""
    with _figure(folder, "training", "PSNR of right halves, dB") as axes:
        for steps in dict.fromkeys(point.steps for point in points if point.variant == BASE):
            way = [point for point in points if (point.variant, point.steps) == (BASE, steps)]
            axes.plot(*_xy(way), "-", color=COLOURS[0], alpha=0.25, linewidth=1)
        for index, variant in enumerate(dict.fromkeys(point.variant for point in points)):
            ends = sorted(finals(p for p in points if p.variant == variant), key=lambda p: p.steps)
            label = "desplat, by length" if variant == BASE else variant
            _bars(axes, ends, index, label, "-" if variant == BASE else "")
        axes.legend(frameon=False, fontsize=8, ncols=2)
    return "training"


def _bars(axes: Any, ends: Sequence[Measured], index: int, label: str, line: str) -> None:
    x, y = _xy(ends)
    below = [point.psnr.median - point.psnr.least for point in ends]
    above = [point.psnr.most - point.psnr.median for point in ends]
    left = [point.wall.median - point.wall.least for point in ends]
    right = [point.wall.most - point.wall.median for point in ends]
    style = f"{MARKERS[index % len(MARKERS)]}{line}"
    color = COLOURS[index % len(COLOURS)]
    axes.errorbar(
        x, y, yerr=[below, above], xerr=[left, right], fmt=style, color=color, label=label,
        markersize=6, capsize=2, elinewidth=1, linewidth=1.6,
    )  # fmt: skip


def _xy(points: Sequence[Measured]) -> tuple[list[float], list[float]]:
    return [point.wall.median for point in points], [point.psnr.median for point in points]


def draw_other_figures(folder: Path, points: Sequence[Measured]) -> list[str]:
    """SSIM, LPIPS and mask IoU of the base's lengths, each if it was measured."""
    names = []
    ends = sorted(finals(p for p in points if p.variant == BASE), key=lambda p: p.steps)
    for name, label in MORE.items():
        label += " (less is better)" * (name == "lpips")
        having = [point for point in ends if name in point.figures]
        if not having:
            continue
        with _figure(folder, name, label) as axes:
            x = [point.wall.median for point in having]
            spreads = [point.figures[name] for point in having]
            axes.plot(x, [s.median for s in spreads], "o-", color=COLOURS[0])
            low, high = [s.least for s in spreads], [s.most for s in spreads]
            axes.fill_between(x, low, high, color=COLOURS[0], alpha=0.15)
        names.append(name)
    return names
