"""Means over what lies near in a photo. Letters in shapes: M places."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int

from desplat_ns.survey.views import View

CELL = 1 / 48
"""Of the longest side. A place's neighbourhood are its cell and the eight around it: a sixteenth of
the longest side, which is about a head in a photo of people who stand near."""


def cell_grid(view: View) -> tuple[int, int, float]:
    """Rows and columns of cells that cover a photo, and a cell's side in pixels."""
    side = max(1.0, CELL * max(view.width, view.height))
    return int(np.ceil(view.height / side)), int(np.ceil(view.width / side)), side


def cells_of(
    view: View, places: Float[np.ndarray, "M 2"]
) -> tuple[Int[np.ndarray, " M"], Int[np.ndarray, " M"]]:
    """Row and column of the cell in which each pixel place inside the photo lies."""
    rows, columns, side = cell_grid(view)
    at = (places / side).astype(int)
    return at[:, 1].clip(0, rows - 1), at[:, 0].clip(0, columns - 1)


def near_means(
    view: View, places: Float[np.ndarray, "M 2"], values: Float[np.ndarray, " M"]
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Mean of the other values near each place (0 where there is none), and how many they are."""
    rows, columns, _ = cell_grid(view)
    at = cells_of(view, places)
    sums = np.zeros((2, rows, columns))
    np.add.at(sums[0], at, values)
    np.add.at(sums[1], at, 1.0)
    total, count = (
        cv2.boxFilter(part, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)[at]
        for part in sums
    )
    count = count - 1
    return np.where(count > 0, (total - values) / np.maximum(count, 1), 0.0), count
