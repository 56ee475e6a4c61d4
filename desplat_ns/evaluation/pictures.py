"""Pictures as people see them: 8-bit colours, layers over a checkerboard."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, UInt8

Picture: TypeAlias = (
    UInt8[np.ndarray, "_ _ 3"]
    | Float[np.ndarray, "_ _ 3"]
    | Float[np.ndarray, "_ _ 1"]
    | Bool[np.ndarray, "_ _ 1"]
)
"""Colours, or one channel to be shown in grey; floats and booleans run from 0 to 1."""


def to_rgb8(picture: Picture) -> UInt8[np.ndarray, "H W 3"]:
    """8-bit colours; floats are clipped to [0, 1] and rounded, NaN is black."""
    values = np.asarray(picture)
    if values.dtype != np.uint8:
        scaled = np.nan_to_num(values.astype(np.float64))
        values = np.round(np.clip(scaled, 0, 1) * 255).astype(np.uint8)
        values = np.broadcast_to(values, (*values.shape[:2], 3)).copy()
    return values


def over_checkerboard(
    rgb: Float[np.ndarray, "H W 3"], alpha: Float[np.ndarray, "H W 1"], size: int = 8
) -> Float[np.ndarray, "H W 3"]:
    """A layer (colours already weighted by alpha) over pale squares of `size` pixels.

    Black and white things can both be told from nothing at all.
    """
    rows, columns = np.indices(alpha.shape[:2]) // size
    squares = np.where((rows + columns) % 2 == 0, 0.92, 0.8)[..., None]
    return (rgb + (1 - alpha) * squares).astype(rgb.dtype)
