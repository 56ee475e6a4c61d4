"""Where world points appear in a small copy of a photo, and where its pixels look.

Letters in shapes: N points, K pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras, CameraType

LONGEST_SIDE = 400
"""Pixels of the small copies: a face in a crowd is a few of them, and no detail is needed."""


@dataclass(frozen=True)
class View:
    """The camera of a small copy: a pose, a lens, a size."""

    rotation: Float[np.ndarray, "3 3"]
    """World to camera; OpenCV axes (x right, y down, z forward)."""
    position: Float[np.ndarray, "3"]
    focal: Float[np.ndarray, "2"]
    """fx, fy in pixels."""
    center: Float[np.ndarray, "2"]
    width: int
    height: int
    distortion: Float[np.ndarray, "6"]
    """k1, k2, k3, k4, p1, p2, as nerfstudio keeps them."""
    is_fisheye: bool

    def project(
        self, points: Float[np.ndarray, "*N 3"]
    ) -> tuple[Float[np.ndarray, "*N 2"], Float[np.ndarray, "*N"]]:
        """Pixels (the first one's centre is at 0.5) and depths; NaN pixels behind the camera."""
        local = (points - self.position) @ self.rotation.T
        depth = local[..., 2]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            flat = local[..., :2] / np.where(depth > 0, depth, np.nan)[..., None]
            flat = self._distorted(flat) if self.distortion.any() or self.is_fisheye else flat
        return flat * self.focal + self.center, depth

    def directions(self, pixels: Float[np.ndarray, "*K 2"]) -> Float[np.ndarray, "*K 3"]:
        """Unit directions in the world, as an undistorted lens of this kind would look.

        What is left out is a few pixels at the corners, which does not matter for a sky.
        """
        flat = (pixels - self.center) / self.focal
        if self.is_fisheye:
            angle = np.linalg.norm(flat, axis=-1, keepdims=True)
            flat = flat * np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-9)
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1) @ self.rotation
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def _distorted(self, flat: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N 2"]:
        """OpenCV's two lens models: radial and tangential, or fisheye."""
        k1, k2, k3, k4, p1, p2 = self.distortion
        x, y = flat[..., 0], flat[..., 1]
        if self.is_fisheye:
            radius = np.sqrt(x * x + y * y)
            angle = np.arctan(radius)
            square = angle * angle
            bent = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
            return flat * (bent / np.maximum(radius, 1e-9))[..., None]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        beside = 2 * p1 * x * y + p2 * (square + 2 * x * x)
        below = p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return flat * radial[..., None] + np.stack([beside, below], axis=-1)


def small_view(cameras: Cameras, index: int) -> View:
    """The camera of one photo, reduced to `LONGEST_SIDE`; smaller photos keep their size."""

    def number(name: str) -> float:
        return float(getattr(cameras, name).reshape(-1)[index])

    width, height = number("width"), number("height")
    ratio = min(1.0, LONGEST_SIDE / max(width, height))
    small = max(1, round(width * ratio)), max(1, round(height * ratio))
    x_ratio, y_ratio = small[0] / width, small[1] / height
    pose = cameras.camera_to_worlds[index].double().cpu().numpy()
    distortion = np.zeros(6)
    if cameras.distortion_params is not None:
        given = cameras.distortion_params.reshape(len(cameras), -1)[index].double().cpu().numpy()
        distortion[: len(given)] = given
    kinds = cameras.camera_type.reshape(-1)
    return View(
        rotation=(pose[:, :3] * [1, -1, -1]).T,  # nerfstudio's axes are OpenGL's
        position=pose[:, 3],
        focal=np.array([number("fx") * x_ratio, number("fy") * y_ratio]),
        center=np.array([number("cx") * x_ratio, number("cy") * y_ratio]),
        width=small[0],
        height=small[1],
        distortion=distortion,
        is_fisheye=int(kinds[index]) == CameraType.FISHEYE.value,
    )
