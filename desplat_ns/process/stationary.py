"""Matches at equal pixel positions: what stands in most photos, and not the scene, ties them.

A watermark, a dashboard, the photographer's stick: where the camera moves, the scene moves in the
picture, and what stays is fixed to the camera. Letters in shapes: M matches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

TOLERANCE = 0.003
"""Of the longer side: 5 pixels of 1600."""
LEAST_TOLERANCE = 2.0
"""Pixels, for small photos."""
SUSPICIOUS = 0.3
"""Share of all verified matches from which on it is said, and they are left out."""


@dataclass(frozen=True)
class Stationary:
    """How many matches sit at equal positions, and where."""

    share: float
    """Of all matches looked at."""
    box: tuple[float, float, float, float] | None
    """Left, top, right, bottom of nine tenths of them, as shares of width and height."""


def is_stationary(
    first: Float[np.ndarray, "M 2"], second: Float[np.ndarray, "M 2"], tolerance: float
) -> Bool[np.ndarray, " M"]:
    """Which matches are at the same place in both photos, to `tolerance` pixels."""
    return np.linalg.norm(first - second, axis=1) <= tolerance


def tolerance_of(width: int, height: int) -> float:
    """Pixels by which equal positions may differ."""
    return max(LEAST_TOLERANCE, TOLERANCE * max(width, height))


def summarise(count: int, places: Float[np.ndarray, "_ 2"]) -> Stationary:
    """The share and the place of stationary matches.

    Args:
        count: matches looked at.
        places: of those that are stationary, as shares of width and height.
    """
    if len(places) == 0:
        return Stationary(0.0, None)
    low, high = np.quantile(places, [0.05, 0.95], axis=0)
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return Stationary(len(places) / count, box)
