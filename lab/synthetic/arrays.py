"""Small helpers for arrays that put coordinates first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def f32(values: Sequence[Any] | np.ndarray) -> np.ndarray:
    """In float32: half the memory traffic, and far finer than a pixel."""
    return np.asarray(values, dtype=np.float32)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product over the first axis, which holds x, y and z."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
