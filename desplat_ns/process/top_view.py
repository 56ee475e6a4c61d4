"""A picture of cameras and points from above.

Letters in shapes: N cameras, P points.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from desplat_ns.errors import DeSplatError

BORDER = 0.6
"""Of the cameras' extent: what is shown around cameras and most points."""


def ground_axes(
    ups: Float[np.ndarray, "N 3"], forwards: Float[np.ndarray, "N 3"]
) -> Float[np.ndarray, "2 3"]:
    """Two directions at right angles to the mean up: what is to the right, and ahead.

    Args:
        ups, forwards: of the cameras, of length 1, in the world.
    """
    up = ups.mean(axis=0)
    up /= max(float(np.linalg.norm(up)), 1e-9)
    ahead = forwards.mean(axis=0)
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 0.1:  # cameras look inwards from all around, or straight down
        ahead = np.linalg.svd(up[None])[2][1]
    ahead = ahead / np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead])


def draw_from_above(view: Path, target: Path, title: str) -> None:
    """Draw what `undistortion` left in `view`.

    Raises:
        DeSplatError: the picture cannot be written.
    """
    with np.load(view) as told:
        axes = ground_axes(told["ups"], told["forwards"])
        centres, points = told["centres"] @ axes.T, told["points"] @ axes.T
        forwards, colors = told["forwards"] @ axes.T, told["colors"] / 255
    low, high = _window(centres, points)
    size = float((high - low).max())
    figure = Figure(figsize=(8, 8), layout="constrained")
    plot = figure.add_subplot()
    inside = ((points >= low) & (points <= high)).all(axis=1)
    plot.scatter(*points[inside].T, c=colors[inside], s=2, linewidths=0)
    lines = np.stack([centres, centres + 0.04 * size * forwards], axis=1)
    plot.add_collection(LineCollection(list(lines), colors="tab:red", linewidths=1))
    plot.scatter(*centres.T, c="tab:red", s=14)
    plot.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
    plot.set_xlabel("cameras red, each with the direction it looks in; the scale is arbitrary")
    try:
        figure.savefig(target, dpi=110)
    except OSError as error:
        raise DeSplatError(f"{target} cannot be written: {error}.") from error


def _window(
    centres: Float[np.ndarray, "N 2"], points: Float[np.ndarray, "P 2"]
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Lower and upper corner: all cameras and most points, those far behind left out."""
    low, high = centres.min(axis=0), centres.max(axis=0)
    if len(points):
        near = np.quantile(points, [0.05, 0.95], axis=0)
        low, high = np.minimum(low, near[0]), np.maximum(high, near[1])
    reach = BORDER / 4 * float((high - low).max() or 1.0)
    return low - reach, high + reach
