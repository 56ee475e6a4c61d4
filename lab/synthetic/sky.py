"""A smooth sky whose colour depends on the direction alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lab.synthetic.arrays import f32
from lab.synthetic.textures import Color


@dataclass(frozen=True)
class Sky:
    """Colours of one photo's sky under canonical light, in [0, 1]."""

    horizon: Color
    zenith: Color
    glow: Color
    """Added to the horizon's colour on the brighter side of the sky."""
    azimuth: float = 0.0
    """Radians from the x axis to the middle of the brighter side, about the vertical."""

    def toward(self, directions: Float[np.ndarray, "3 *R"]) -> Float[np.ndarray, "3 *R"]:
        """Colours in world directions of any length.

        For a unit direction d with height z, and the horizontal unit vector b to the brighter side:
        `horizon + (zenith - horizon) z (2 - z) + glow ((1 + b.d) / 2)^2`: a polynomial of degree
        2, so spherical harmonics of degree 2 represent it exactly. Below the horizon (z < 0) the
        second term is left out.
        """
        x, y, z = directions / np.sqrt((directions * directions).sum(axis=0))
        rise = np.maximum(z, 0) * (2 - z)
        along = x * np.float32(np.cos(self.azimuth)) + y * np.float32(np.sin(self.azimuth))
        side = ((1 + along) / 2) ** 2
        horizon, zenith, glow = (
            f32(color).reshape(3, *[1] * z.ndim) for color in (self.horizon, self.zenith, self.glow)
        )
        return horizon + (zenith - horizon) * rise + glow * side
