"""The Gaussians of a file: what every format can hold, and nothing of nerfstudio.

Letters in shapes: N Gaussians, K spherical-harmonics bases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

MAX_DEGREE = 3
"""Of the spherical harmonics that PLY, SPZ and glTF readers take."""


@dataclass(frozen=True)
class SplatCloud:
    """Static Gaussians after activation, with the colours of one light."""

    means: Float[np.ndarray, "N 3"]
    """float64: a capture's own coordinates may lie far out."""
    quats: Float[np.ndarray, "N 4"]
    """wxyz, of length 1."""
    scales: Float[np.ndarray, "N 3"]
    """Standard deviations along the rotated axes, > 0, in the units of `means`."""
    opacities: Float[np.ndarray, " N"]
    """In [0, 1]."""
    harmonics: Float[np.ndarray, "N K 3"]
    """Coefficients in 3DGS's sign convention; the colour is max(SH + 1/2, 0)."""
    antialiased: bool = False
    """Whether opacities are meant for Mip-Splatting's low-pass filter."""

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Of the harmonics: K = (degree + 1)^2."""
        return math.isqrt(self.harmonics.shape[1]) - 1

    def rows(self, chosen: Bool[np.ndarray, " N"]) -> SplatCloud:
        """The chosen Gaussians only."""
        return replace(
            self,
            means=self.means[chosen],
            quats=self.quats[chosen],
            scales=self.scales[chosen],
            opacities=self.opacities[chosen],
            harmonics=self.harmonics[chosen],
        )


def xyzw(quats: Float[np.ndarray, "N 4"]) -> Float[np.ndarray, "N 4"]:
    """Quaternions wxyz in the order of glTF and SPZ."""
    return np.roll(quats, -1, axis=1)
