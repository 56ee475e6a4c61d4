"""What a rasterizer takes and gives: the one seam between the model and every backend.

Letters in shapes: N Gaussians, K spherical-harmonics bases, C colour channels, H x W pixels.
Conventions are gsplat's: EWA splatting, pixel centres at +0.5, OpenCV camera axes
(x right, y down, z forward), quaternions wxyz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float, Int
from torch import Tensor

MAX_FAR = 1e20
"""World units. The slope of an expected depth is up to the depth over its least weight, 1e-10."""


@dataclass(frozen=True)
class Splats:
    """Activated Gaussians, in world units."""

    means: Float[Tensor, "N 3"]
    quats: Float[Tensor, "N 4"]
    """Rotations, wxyz; the backend normalizes them."""
    scales: Float[Tensor, "N 3"]
    """Standard deviations along the rotated axes, > 0."""
    opacities: Float[Tensor, " N"]
    """In [0, 1]."""
    colors: Float[Tensor, "N C"] | Float[Tensor, "N K 3"]
    """Final colours, or spherical-harmonics coefficients where `sh_degree` is set."""
    sh_degree: int | None = None
    """Degree to evaluate, (sh_degree + 1)^2 <= K; the evaluated colour is max(SH + 1/2, 0)."""


@dataclass(frozen=True)
class View:
    """One pinhole camera."""

    viewmat: Float[Tensor, "4 4"]
    """World to camera, OpenCV axes."""
    K: Float[Tensor, "3 3"]
    """Intrinsics in pixels."""
    width: int
    height: int


@dataclass(frozen=True)
class RenderSettings:
    """How to rasterize. Raises ValueError where a number lies outside its range."""

    near_plane: float = 0.01
    """World units, > 0; what lies nearer is culled. nerfstudio's value."""
    far_plane: float = 1e10
    """World units, beyond the near plane and at most MAX_FAR; what lies further off is culled."""
    eps2d: float = 0.3
    """Added to the diagonal of the 2D covariance, pixels^2, >= 0 (EWA low-pass)."""
    antialiased: bool = False
    """Scale opacities by sqrt(det(cov2d) / det(cov2d + eps2d I)), Mip-Splatting."""
    depth: bool = False
    """Also render the expected depth."""
    absgrad: bool = False
    """After backward, `Rendering.means2d.absgrad` holds the sum over pixels of |d loss / d mean|,
    [1, N, 2]."""

    def __post_init__(self) -> None:
        for name, fits, needed in (
            ("near_plane", 0 < self.near_plane < math.inf, "positive and finite"),
            (
                "far_plane",
                self.near_plane < self.far_plane <= MAX_FAR,
                f"beyond the near plane and at most {MAX_FAR:g}",
            ),
            ("eps2d", 0 <= self.eps2d < math.inf, "0 or more, and finite"),
        ):
            if not fits:
                raise ValueError(f"{name} is {getattr(self, name)}; it has to be {needed}.")


@dataclass(frozen=True)
class Rendering:
    """One rasterized layer."""

    rgb: Float[Tensor, "H W C"]
    """Colour weighted by alpha, on a black background."""
    alpha: Float[Tensor, "H W 1"]
    """Accumulated opacity, in [0, 1)."""
    depth: Float[Tensor, "H W 1"] | None
    """sum(w z) / sum(w), world units along the optical axis; 0 where nothing is, None if not asked
    for."""
    means2d: Float[Tensor, "1 N 2"]
    """Projected means in pixels, part of the graph: densification reads their gradient."""
    radii: Int[Tensor, " N"]
    """Extent on the image in pixels (3 sigma, rounded up); 0 where culled."""

    @property
    def visible(self) -> Bool[Tensor, " N"]:
        """Which Gaussians the view shows: those that were not culled."""
        return self.radii > 0


@runtime_checkable
class Rasterizer(Protocol):
    """A backend. To add one, see CONTRIBUTING.md."""

    name: str

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`. Differentiable in every tensor of `splats`."""
        ...
