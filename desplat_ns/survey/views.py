"""Where world points appear in a small copy of a photo, where its pixels look, what is near.

Letters in shapes: N points, K pixels, M places.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from nerfstudio.cameras.cameras import Cameras, CameraType

LONGEST_SIDE = 400
"""Pixels of the small copies: a face in a crowd is a few of them, and no detail is needed."""

CELL = 1 / 48
"""Of the longest side. A place's neighbourhood are its cell and the eight around it: a sixteenth of
the longest side, which is about a head in a photo of people who stand near."""


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
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            local = (points - self.position) @ self.rotation.T
            depth = local[..., 2]
            flat = local[..., :2] / np.where(depth > 0, depth, np.nan)[..., None]
            flat = self._distorted(flat) if self.distortion.any() or self.is_fisheye else flat
        return flat * self.focal + self.center, depth

    def shows(
        self, places: Float[np.ndarray, "*N 2"], depths: Float[np.ndarray, "*N"], margin: float = 0
    ) -> Bool[np.ndarray, "*N"]:
        """Which of projected points lie in the photo, so many pixels from its border at least."""
        with np.errstate(invalid="ignore"):
            inside = (places >= margin) & (places <= np.array(self.size) - margin)
            return inside.all(axis=-1) & (depths > 0)

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

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def cell(self) -> float:
        """Pixels of a cell's side."""
        return max(1.0, CELL * max(self.width, self.height))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of cells that cover the photo."""
        return int(np.ceil(self.height / self.cell)), int(np.ceil(self.width / self.cell))

    def cells_of(
        self, places: Float[np.ndarray, "M 2"]
    ) -> tuple[Int[np.ndarray, " M"], Int[np.ndarray, " M"]]:
        """Row and column of the cell in which each pixel place inside the photo lies."""
        at = (places / self.cell).astype(int)
        return at[:, 1].clip(0, self.grid[0] - 1), at[:, 0].clip(0, self.grid[1] - 1)

    def near_means(
        self, places: Float[np.ndarray, "M 2"], values: Float[np.ndarray, " M"]
    ) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
        """Mean of the other values near each place (0 where there is none), and their number."""
        at = self.cells_of(places)
        sums = np.zeros((2, *self.grid))
        np.add.at(sums[0], at, values)
        np.add.at(sums[1], at, 1.0)
        total, count = (
            cv2.boxFilter(part, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)[at]
            for part in sums
        )
        count = count - 1
        return np.where(count > 0, (total - values) / np.maximum(count, 1), 0.0), count

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
