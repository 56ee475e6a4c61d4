"""What a rasterizer takes and gives: the one seam between the model and every backend.

Letters in shapes: N Gaussians, K spherical-harmonics bases, H x W pixels.
Conventions are gsplat's: EWA splatting, pixel centres at +0.5, OpenCV camera axes
(x right, y down, z forward), quaternions wxyz.
"""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from jaxtyping import Bool, Float, Int
from torch import Tensor


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
    colors: Float[Tensor, "N 3"] | Float[Tensor, "N K 3"]
    """Final colours, or spherical-harmonics coefficients where `sh_degree` is set."""
    sh_degree: int | None = None
    """Degree to evaluate, (sh_degree + 1)^2 <= K; the evaluated colour is max(SH + 1/2, 0),
    with the gradient of `projection.cut_at_zero`."""

    def rows(self, chosen: Bool[Tensor, " N"] | Int[Tensor, " M"]) -> "Splats":
        """Some of them."""
        names = ("means", "quats", "scales", "opacities", "colors")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


@dataclass(frozen=True)
class View:
    """One pinhole camera."""

    viewmat: Float[Tensor, "4 4"]
    """World to camera, OpenCV axes."""
    K: Float[Tensor, "3 3"]
    """Intrinsics in pixels."""
    width: int
    height: int

    @property
    def center(self) -> Float[Tensor, "3"]:
        """Where the camera stands, in the world."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


@dataclass(frozen=True)
class RenderSettings:
    """How to rasterize."""

    antialiased: bool = False
    """Scale opacities by sqrt(det(cov2d) / det(cov2d + EPS2D I)), Mip-Splatting."""
    depth: bool = False
    """Also render the expected depth."""
    absgrad: bool = False
    """After backward, `Rendering.means2d.absgrad` [1, N, 2] sums |d loss / d mean| over pixels."""


@dataclass(frozen=True)
class Rendering:
    """One rasterized layer."""

    rgb: Float[Tensor, "H W 3"]
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
