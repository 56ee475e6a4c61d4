"""The plots of a report, each as SVG and PNG."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from desplat_ns.studies.tradeoff.plan import BASE
from desplat_ns.studies.tradeoff.summary import Measured, finals

SIZE = (6.6, 4.4)
"""Inches: one panel, so that it can be read on a telephone."""

COLOURS = ("#0b6e99", "#c4452d", "#4f8a3b", "#8b5fbf", "#d08a1d", "#2a9d8f", "#a23b72", "#6b705c")
MARKERS = "osD^vPXhd"
MORE = {"ssim": "SSIM", "lpips": "LPIPS (less is better)", "mask_iou": "mask IoU"}
"""Other figures of a run, as plots call them."""

TRAINING_SECONDS = "training time, s of wall time"


@contextmanager
def _figure(folder: Path, name: str) -> Iterator[Any]:
    """Axes whose picture is written as NAME.svg and NAME.png."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": name}
    with matplotlib.rc_context({**style, "font.size": 10, "font.family": "sans-serif"}):
        figure = Figure(figsize=SIZE, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.grid(True, which="major", alpha=0.25)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        yield axes
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
        figure.savefig(folder / f"{name}.png", dpi=130, metadata={"Software": None})


def draw_all(
    folder: Path,
    found: Sequence[Measured],
    pixels: Mapping[str, Any] | None,
    evaluation: Sequence[Mapping[str, Any]],
) -> list[str]:
    """Draw what there is; the names of the plots."""
    names = []
    if found:
        names.append(draw_training(folder, found))
        names += draw_other_figures(folder, found)
    if pixels and pixels["points"]:
        names += draw_pixels(folder, pixels["points"])
    if any(one["steps"] is not None for one in evaluation):
        names.append(draw_evaluation(folder, evaluation))
    return names


def draw_training(folder: Path, found: Sequence[Measured]) -> str:
    """PSNR against training time: every setting with its spread, the base's lengths as a line."""
    with _figure(folder, "training") as axes:
        for steps in dict.fromkeys(one.steps for one in found if one.setting == BASE):
            way = [one for one in found if (one.setting, one.steps) == (BASE, steps)]
            axes.plot(*_xy(way), "-", color=COLOURS[0], alpha=0.25, linewidth=1)
        for index, setting in enumerate(dict.fromkeys(one.setting for one in found)):
            ends = sorted(finals(o for o in found if o.setting == setting), key=lambda o: o.steps)
            label = "desplat, by length" if setting == BASE else setting
            _bars(axes, ends, index, label, "-" if setting == BASE else "")
        axes.set(xscale="log", xlabel=TRAINING_SECONDS, ylabel="PSNR of right halves, dB")
        _plain_numbers(axes.xaxis)
        axes.legend(frameon=False, fontsize=8, ncols=2)
    return "training"


def _bars(axes: Any, ends: Sequence[Measured], index: int, label: str, line: str) -> None:
    x, y = _xy(ends)
    below = [one.psnr.median - one.psnr.least for one in ends]
    above = [one.psnr.most - one.psnr.median for one in ends]
    left = [one.wall.median - one.wall.least for one in ends]
    right = [one.wall.most - one.wall.median for one in ends]
    style = f"{MARKERS[index % len(MARKERS)]}{line}"
    color = COLOURS[index % len(COLOURS)]
    axes.errorbar(
        x, y, yerr=[below, above], xerr=[left, right], fmt=style, color=color, label=label,
        markersize=6, capsize=2, elinewidth=1, linewidth=1.6,
    )  # fmt: skip


def _xy(found: Sequence[Measured]) -> tuple[list[float], list[float]]:
    return [one.wall.median for one in found], [one.psnr.median for one in found]


def draw_other_figures(folder: Path, found: Sequence[Measured]) -> list[str]:
    """SSIM, LPIPS and mask IoU of the base's lengths, each if it was measured."""
    names = []
    ends = sorted(finals(o for o in found if o.setting == BASE), key=lambda o: o.steps)
    for name, label in MORE.items():
        having = [one for one in ends if name in one.figures]
        if not having:
            continue
        with _figure(folder, name) as axes:
            x = [one.wall.median for one in having]
            spreads = [one.figures[name] for one in having]
            axes.plot(x, [s.median for s in spreads], "o-", color=COLOURS[0])
            low, high = [s.least for s in spreads], [s.most for s in spreads]
            axes.fill_between(x, low, high, color=COLOURS[0], alpha=0.15)
            axes.set(xscale="log", xlabel=TRAINING_SECONDS, ylabel=label)
            _plain_numbers(axes.xaxis)
        names.append(name)
    return names


def draw_pixels(folder: Path, points: Sequence[Mapping[str, Any]]) -> list[str]:
    """Errors against time of each dial: of the picture, and of the gradients."""
    panels: dict[str, tuple[str, str, str, str]] = {
        "picture": ("forward_ms", "picture_error", "forward, ms", "error of the picture (RMSE)"),
        "gradients": (
            "both_ms",
            "gradient_error",
            "forward and backward, ms",
            "relative error of the worst gradient",
        ),
    }
    chosen = [one for one in points if one["group"] == "rasterizing"]
    return [_draw_panel(folder, f"pixels-{name}", chosen, *panel) for name, panel in panels.items()]


def _draw_panel(
    folder: Path, name: str, points: Sequence[Mapping[str, Any]], x: str, y: str, *labels: str
) -> str:
    with _figure(folder, name) as axes:
        for index, dial in enumerate(dict.fromkeys(one["dial"] for one in points)):
            of_dial = [one for one in points if one["dial"] == dial]
            marker, color = MARKERS[index % len(MARKERS)], COLOURS[index % len(COLOURS)]
            xs, ys = [one[x] for one in of_dial], [one[y] for one in of_dial]
            axes.plot(xs, ys, marker, color=color, label=dial, markersize=5)
        default = [one for one in points if one["is_default"]]
        rings = {"markersize": 13, "markerfacecolor": "none", "color": "black"}
        xs, ys = [one[x] for one in default], [one[y] for one in default]
        axes.plot(xs, ys, "o", label="today's default", **rings)
        axes.set(xscale="log", yscale="log", xlabel=labels[0], ylabel=labels[1])
        _plain_numbers(axes.xaxis)
        axes.legend(frameon=False, fontsize=8)
    return name


def draw_evaluation(folder: Path, scores: Sequence[Mapping[str, Any]]) -> str:
    """PSNR against the steps for an embedding; settings without any as lines across."""
    with _figure(folder, "evaluation") as axes:
        for index, setting in enumerate(dict.fromkeys(one["setting"] for one in scores)):
            of_setting = [one for one in scores if one["setting"] == setting]
            color = COLOURS[index % len(COLOURS)]
            searched = [one for one in of_setting if one["steps"] is not None]
            if searched:
                xs, ys = [one["steps"] for one in searched], [one["psnr"] for one in searched]
                axes.plot(xs, ys, "o-", color=color, label=setting)
            elif setting == BASE or setting.startswith("appearance"):
                axes.axhline(of_setting[0]["psnr"], color=color, linestyle="--", label=setting)
        axes.set_xscale("symlog", linthresh=8)
        axes.set(xlabel="steps for the embedding of a photo", ylabel="PSNR of right halves, dB")
        axes.set_xticks([0, 8, 32, 128, 512])
        _plain_numbers(axes.xaxis)
        axes.legend(frameon=False, fontsize=8)
    return "evaluation"


def _plain_numbers(axis: Any) -> None:
    """10, 100 instead of powers."""
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
