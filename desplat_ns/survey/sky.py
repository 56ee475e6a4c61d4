"""Cells of a photo that have nothing behind them: a sky, as far as that can be told.

No point of the whole reconstruction lies in such a cell's direction or near it, it is smooth, it
lies clearly above the horizon, and nothing lies above it. A bare wall or ceiling that high above
everything else looks the same.
Letters in shapes: V photos, R x C cells, K sky cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from desplat_ns.survey.observations import Observations
from desplat_ns.survey.views import View

AROUND = 5
"""Cells across the disc around a point in which something counts as behind: a tenth of the side."""

SMOOTH = 0.04
"""Mean change of the values from pixel to pixel, across plus down, below which a cell is smooth:
clouds are, leaves against the sky are not."""

UPRIGHT = 0.05
"""Weight of the cameras' own up against their horizontals, which tell the vertical better."""

LEAST_RISE = float(np.sin(np.radians(6.0)))
"""Of a direction above the horizon. Photos that look down on something show the walls of a room up
to there; nine tenths of a sky's area were more than 8 degrees above it."""

STEEP = 0.3
"""Length of the vertical in the image plane below which a photo looks up or down too steeply."""


@dataclass(frozen=True)
class Sky:
    """The sky of one photo, if any."""

    cells: Bool[np.ndarray, "R C"]
    values: Float[np.ndarray, "R C 3"]
    """Mean of each cell's values in [0, 1]."""
    directions: Float[np.ndarray, "R C 3"]
    """In the world, unit."""

    @property
    def share(self) -> float:
        """Of the photo's area."""
        return float(self.cells.mean())

    def inner(self) -> Bool[np.ndarray, "R C"]:
        """Sky cells around which all is sky: their colours are of the sky alone."""
        around = np.ones((3, 3), np.uint8)
        padded = cv2.copyMakeBorder(self.cells.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        return cv2.erode(padded, around)[1:-1, 1:-1] > 0


def vertical(views: list[View]) -> Float[np.ndarray, "3"]:
    """The world's up, from how the cameras were held: their x axes are horizontal."""
    right = np.array([view.rotation[0] for view in views])
    up = -np.mean([view.rotation[1] for view in views], axis=0)
    left = right.T @ right / len(right) + UPRIGHT * np.eye(3)
    direction = np.linalg.solve(left, UPRIGHT * up)
    return direction / max(float(np.linalg.norm(direction)), 1e-12)


def find_sky(observations: Observations, row: int, up: Float[np.ndarray, "3"]) -> Sky:
    """The sky of photo `row`.

    Args:
        up: see `vertical`.
    """
    view, photo = observations.views[row], observations.photos[row]
    rows, columns = view.grid
    centers = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    directions = view.directions(centers * view.cell)
    behind = _something_behind(observations, view)
    cells = ~behind & (_roughness(photo, columns, rows) < SMOOTH) & (directions @ up > LEAST_RISE)
    cells &= _nothing_above(behind, view.rotation @ up)
    small = cv2.resize(photo, (columns, rows), interpolation=cv2.INTER_AREA) / 255.0
    allowed = observations.allowed[row].astype(np.float32)
    cells &= cv2.resize(allowed, (columns, rows), interpolation=cv2.INTER_AREA) > 0.99
    return Sky(cells, small, directions)


def _something_behind(observations: Observations, view: View) -> np.ndarray:
    places, depths = view.project(observations.all_xyz)
    hit = np.zeros(view.grid, np.uint8)
    hit[view.cells_of(places[view.shows(places, depths)])] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (AROUND, AROUND))
    return cv2.dilate(hit, disc) > 0


def _roughness(photo: np.ndarray, columns: int, rows: int) -> np.ndarray:
    grey: np.ndarray = photo.astype(np.float32).mean(axis=2) / 255
    across = np.abs(np.diff(grey, axis=1, prepend=grey[:, :1]))
    down = np.abs(np.diff(grey, axis=0, prepend=grey[:1]))
    change = np.asarray(across + down, np.float32)
    return cv2.resize(change, (columns, rows), interpolation=cv2.INTER_AREA)


def _nothing_above(behind: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Cells from which the way up (`up` in camera axes) to the border meets nothing."""
    length = float(np.hypot(up[0], up[1]))
    if length < STEEP:
        return np.zeros_like(behind)
    step = up[:2] / length
    rows, columns = np.indices(behind.shape)
    is_open = np.ones_like(behind)
    for count in range(1, sum(behind.shape)):
        x = np.rint(columns + count * step[0]).astype(int)
        y = np.rint(rows + count * step[1]).astype(int)
        inside = (x >= 0) & (x < behind.shape[1]) & (y >= 0) & (y < behind.shape[0])
        if not inside.any():
            break
        is_open[inside] &= ~behind[y[inside], x[inside]]
    return is_open
