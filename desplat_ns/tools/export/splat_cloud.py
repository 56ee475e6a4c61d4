"""The Gaussians of a file: taken from a model in one light, and moved to a file's coordinates.
Letters in shapes: N Gaussians, K spherical-harmonics bases."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.camera_utils import quaternion_from_matrix
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF, FAR_PLANE
from desplat_ns.backend.inputs import is_finite
from desplat_ns.backend.protocol import Splats
from desplat_ns.backend.spherical_harmonics import sh_basis
from desplat_ns.core.errors import ConfigError
from desplat_ns.gaussians.activation import MAX_LOG_SCALE
from desplat_ns.photo_tourism.appearance import as_harmonics
from desplat_ns.tools.export.formats import Axes, FrameName

MAX_DEGREE = 3
"""Of the spherical harmonics that readers of PLY and SPZ take."""
TOO_WIDE = math.exp(MAX_LOG_SCALE) / 2
"""World units. Wider Gaussians are culled in every view."""
OFF_BY = 1 / 32
"""Of its scale, by which a Gaussian's place may be off along an axis: as far as the rounding of the
scale in SPZ, by 1/32 of its logarithm, moves the Gaussian's edge. Coarser places cost more than all
other rounding, finer ones gain nothing (docs/results/quality.md)."""
PRECISE = 0.9
"""Of the Gaussians, so many are to be in place so well, by the middle one of their three scales:
nobody sees where along the smallest one a disc lies."""
FAR = 0.01
"""Of the Gaussians, so many may lie too far away for that: more are a part of the scene."""


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
    offset: tuple[float, ...] = ()
    """x, y, z to add to `means` where they would be too large for float32; see `near_zero`."""

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Of the harmonics: K = (degree + 1)^2."""
        return math.isqrt(self.harmonics.shape[1]) - 1

    def rows(self, chosen: Bool[np.ndarray, " N"]) -> "SplatCloud":
        arrays = {n: v for n, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **{name: values[chosen] for name, values in arrays.items()})

    @property
    def size(self) -> float:
        """Of the middle ones of their scales: a share `PRECISE` of the Gaussians is larger."""
        return float(np.quantile(np.sort(self.scales, axis=1)[:, 1], 1 - PRECISE))


@torch.no_grad()
def shown_anywhere(splats: Splats) -> Bool[Tensor, " N"]:
    """Which Gaussians some view may show: finite ones, not too far, wide or faint to be drawn."""
    near = splats.means.abs().amax(-1) < FAR_PLANE
    drawn = near & (splats.scales.amax(-1) <= TOO_WIDE) & (splats.opacities >= ALPHA_CUTOFF)
    return is_finite(splats) & drawn


def baked(splats: Splats, antialiased: bool) -> SplatCloud:
    """Gaussians of a model, activated, with the colours of one light, as a file holds them: those
    that are `shown_anywhere`. Raises ConfigError where that is none."""
    shown = shown_anywhere(splats)
    if not shown.any():
        raise ConfigError(
            "No training camera shows any of the static Gaussians: there is nothing to export. "
            "Train longer, or take an earlier checkpoint."
        )
    splats = splats.rows(shown)
    quats = torch.nn.functional.normalize(splats.quats, dim=-1)
    values = (splats.means.double(), quats, splats.scales, splats.opacities)
    means, quats, scales, opacities = (value.detach().cpu().numpy() for value in values)
    return SplatCloud(means, quats, scales, opacities, harmonics_of(splats), antialiased)


def harmonics_of(splats: Splats) -> Float[np.ndarray, "N K 3"]:
    """Coefficients as files hold them: those that are evaluated yet, up to degree `MAX_DEGREE`."""
    splats = as_harmonics(splats)
    assert splats.sh_degree is not None
    bases = (min(splats.sh_degree, MAX_DEGREE) + 1) ** 2
    return splats.colors[:, :bases].detach().cpu().numpy()


@dataclass(frozen=True)
class Similarity:
    """p -> scale * turn p + shift."""

    turn: Float[np.ndarray, "3 3"]
    """Orthogonal; a reflection, of determinant -1, is one."""
    scale: float
    shift: Float[np.ndarray, "3"]


def similarity_to(
    frame: FrameName, transform: Float[np.ndarray, "3 4"], scale: float, upright_axes: Axes
) -> Similarity:
    """From the coordinates of training to those of a file.

    training: as it is. upright: the capture's scale, the scene's up as the file's up, the origin of
    training. capture: the capture's own coordinates, to lay over its points. `transform` and then
    `scale` are the dataparser's, from there to training; `upright_axes` lead from nerfstudio's axes
    (z up) to the file's.
    """
    if frame == "training":
        return Similarity(np.eye(3), 1.0, np.zeros(3))
    matrix = np.asarray(transform, np.float64)
    stretch = np.cbrt(abs(np.linalg.det(matrix[:, :3])))
    turn = matrix[:, :3] / stretch
    unscaled = 1 / (float(scale) * stretch)
    if frame == "upright":
        return Similarity(np.asarray(upright_axes, np.float64), unscaled, np.zeros(3))
    # Of float32 the turn is orthogonal to seven digits, which are metres of a large shift.
    return Similarity(turn.T, unscaled, np.linalg.solve(matrix[:, :3], -matrix[:, 3]))


def near_zero(cloud: SplatCloud) -> SplatCloud:
    """The same Gaussians with an offset, in whole units, where places of float32, as in files and
    viewers, would be off by more than `OFF_BY`: those of geo-referenced captures."""
    reach = np.quantile(np.abs(cloud.means).max(axis=1), 1 - FAR, method="higher")
    if np.spacing(np.float32(reach)) / 2 <= OFF_BY * cloud.size:
        return cloud
    offset = np.rint(np.median(cloud.means, axis=0))
    return replace(cloud, means=cloud.means - offset, offset=tuple(offset.tolist()))


def moved(cloud: SplatCloud, by: Similarity) -> SplatCloud:
    """The same scene in other coordinates: what a camera that moves along sees does not change. An
    ellipsoid is its own mirror image through its centre, so a reflection turns it as the turn of
    opposite sign does."""
    w, x, y, z = quaternion_from_matrix(by.turn * np.sign(np.linalg.det(by.turn)))
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    quats = cloud.quats @ product.T
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return replace(
        cloud,
        means=cloud.means @ (by.scale * by.turn.T) + by.shift,
        quats=quats.astype(np.float32),
        scales=(cloud.scales * by.scale).astype(np.float32),
        harmonics=turned_harmonics(cloud.harmonics, by.turn),
    )


def turned_harmonics(
    harmonics: Float[np.ndarray, "N K 3"], turn: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "N K 3"]:
    """Coefficients c' with sum_k c'_k Y_k(turn d) = sum_k c_k Y_k(d) for every direction d. A turn
    mixes the harmonics linearly: the mixing matrix is solved for from more directions, which spread
    over the sphere as a Fibonacci lattice, than there are harmonics, in float64."""
    degree = round(harmonics.shape[1] ** 0.5) - 1
    if degree == 0:
        return harmonics
    steps = np.arange(4 * harmonics.shape[1]) + 0.5
    z, angle = 1 - 2 * steps / len(steps), np.pi * (1 + 5**0.5) * steps
    radius = np.sqrt(1 - z**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    there = sh_basis(degree, torch.from_numpy(directions)).numpy()
    after = sh_basis(degree, torch.from_numpy(directions @ turn.T)).numpy()
    mixing = np.linalg.lstsq(after, there, rcond=None)[0]
    return np.einsum("jk,nkc->njc", mixing.astype(harmonics.dtype), harmonics)
