"""In which coordinates a file is: Gaussians turned, scaled and shifted, harmonics and all.

Letters in shapes: N Gaussians, K spherical-harmonics bases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from nerfstudio.cameras.camera_utils import quaternion_from_matrix

from desplat_ns.backend.spherical_harmonics import sh_basis
from desplat_ns.errors import CaptureError
from desplat_ns.export.formats import Axes, Frame
from desplat_ns.export.splat_cloud import SplatCloud

ORTHOGONAL_TOLERANCE = 1e-4
"""How far a transform's columns may be from orthonormal: it comes as float32, a product of two."""


@dataclass(frozen=True)
class Similarity:
    """p -> scale * turn p + shift."""

    turn: Float[np.ndarray, "3 3"]
    """Orthogonal; a reflection, of determinant -1, is one."""
    scale: float
    shift: Float[np.ndarray, "3"]


def similarity_to(
    frame: Frame,
    transform: Float[np.ndarray, "3 4"],
    scale: float,
    upright_axes: Axes,
) -> Similarity:
    """From the coordinates of training to those of a file.

    training: as it is. upright: the capture's scale, the scene's up as the file's up, the origin of
    training. capture: the capture's own coordinates, to lay over its points.

    Args:
        transform: the dataparser's: the capture's coordinates to those of training, before scaling.
        scale: the dataparser's.
        upright_axes: from nerfstudio's axes (z up) to the file's.

    Raises:
        CaptureError: the transform bends or stretches, so Gaussians cannot follow it.
    """
    if frame == "training":
        return Similarity(np.eye(3), 1.0, np.zeros(3))
    matrix = np.asarray(transform, np.float64)
    stretch = np.cbrt(abs(np.linalg.det(matrix[:, :3])))
    turn = matrix[:, :3] / stretch
    if not np.allclose(turn @ turn.T, np.eye(3), atol=ORTHOGONAL_TOLERANCE):
        raise CaptureError(
            "The capture's own coordinates differ from those of training by more than a turn, a "
            "shift and a scale (`applied_transform` in its transforms.json?), which Gaussians "
            "cannot follow. Add `--frame training`."
        )
    unscaled = 1 / (float(scale) * stretch)
    if frame == "upright":
        return Similarity(np.asarray(upright_axes, np.float64), unscaled, np.zeros(3))
    return Similarity(turn.T, unscaled, -turn.T @ matrix[:, 3] / stretch)


def moved(cloud: SplatCloud, by: Similarity) -> SplatCloud:
    """The same scene in other coordinates: what a camera that moves along sees does not change."""
    return replace(
        cloud,
        means=cloud.means @ (by.scale * by.turn.T) + by.shift,
        quats=_turned_quats(cloud.quats, by.turn),
        scales=(cloud.scales * by.scale).astype(np.float32),
        harmonics=turned_harmonics(cloud.harmonics, by.turn),
    )


def turned_harmonics(
    harmonics: Float[np.ndarray, "N K 3"], turn: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "N K 3"]:
    """Coefficients c' with sum_k c'_k Y_k(turn d) = sum_k c_k Y_k(d) for every direction d.

    A turn mixes the harmonics of one degree only, linearly: the mixing matrix is solved for from
    more directions than there are harmonics, in float64.
    """
    degree = round(harmonics.shape[1] ** 0.5) - 1
    if degree == 0:
        return harmonics
    directions = _spread_directions(4 * harmonics.shape[1])
    there = sh_basis(degree, torch.from_numpy(directions)).numpy()
    after = sh_basis(degree, torch.from_numpy(directions @ turn.T)).numpy()
    mixing = np.linalg.lstsq(after, there, rcond=None)[0]
    return np.einsum("jk,nkc->njc", mixing.astype(harmonics.dtype), harmonics)


def _spread_directions(count: int) -> Float[np.ndarray, "count 3"]:
    """Unit vectors spread evenly over the sphere: a Fibonacci lattice."""
    steps = np.arange(count) + 0.5
    z = 1 - 2 * steps / count
    angle = np.pi * (1 + 5**0.5) * steps
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _turned_quats(
    quats: Float[np.ndarray, "N 4"], turn: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "N 4"]:
    """Quaternions of turn R. An ellipsoid is its own mirror image through its centre, so that a
    reflection may be taken as the turn with the opposite sign."""
    w, x, y, z = quaternion_from_matrix(turn * np.sign(np.linalg.det(turn)))
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    turned = quats @ left.T
    return (turned / np.linalg.norm(turned, axis=1, keepdims=True)).astype(np.float32)
