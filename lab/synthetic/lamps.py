"""What glossy things mirror."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from lab.synthetic.arrays import dot, f32

LAMPS = ((0.5, 0.3, 0.8), (-0.7, 0.1, 0.7), (0.0, -0.8, 0.5))
"""Directions to lamps that glossy things mirror."""

SHARPNESS = 60.0
"""Exponent of a lamp's reflection (Phong): a highlight some 20 degrees wide."""


def mirrored(directions: Float[np.ndarray, "3 N"]) -> Float[np.ndarray, "3 N"]:
    """Light in [0, 1] that comes from unit directions: dim walls, and lamps."""
    light = np.repeat(0.25 + 0.15 * directions[2:], 3, axis=0)
    for lamp in LAMPS:
        toward = f32(lamp) / np.float32(np.linalg.norm(lamp))
        light = light + np.maximum(dot(directions, toward[:, None]), 0) ** np.float32(SHARPNESS)
    return np.clip(light, 0, 1).astype(np.float32)
