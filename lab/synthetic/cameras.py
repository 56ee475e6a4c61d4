"""Pinhole cameras and the arc on which they stand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class PinholeCamera:
    """One undistorted camera, OpenCV axes (x right, y down, z forward)."""

    K: Float[np.ndarray, "3 3"]
    """Intrinsics in pixels; the centre of the first pixel is at (0.5, 0.5)."""
    viewmat: Float[np.ndarray, "4 4"]
    """World to camera."""
    width: int
    height: int

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """Optical centre in the world, metres."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]

    def with_size(self, width: int, height: int) -> "PinholeCamera":
        """The same pose and the same angle of view along the longer side, in another format."""
        scale = max(width, height) / max(self.width, self.height)
        fx, fy = scale * self.K[0, 0], scale * self.K[1, 1]
        K = np.array([[fx, 0, width / 2], [0, fy, height / 2], [0, 0, 1.0]])
        return PinholeCamera(K, self.viewmat, width, height)

    def rays(self, supersample: int) -> Float[np.ndarray, "3 h w"]:
        """Directions in the world through `supersample`^2 samples of each pixel, on a regular grid.

        Scaled so that a step of 1 along a ray is a step of 1 along the optical axis: the ray's
        parameter is the depth.
        """
        x = (np.arange(self.width * supersample) + 0.5) / supersample
        y = (np.arange(self.height * supersample) + 0.5) / supersample
        xs, ys = np.meshgrid(x, y)
        pixels = np.stack([xs, ys, np.ones_like(xs)]).reshape(3, -1)
        directions = self.viewmat[:3, :3].T @ np.linalg.inv(self.K) @ pixels
        return directions.reshape(3, *xs.shape).astype(np.float32)

    def project(
        self, points: Float[np.ndarray, "3 N"]
    ) -> tuple[Float[np.ndarray, "2 N"], Float[np.ndarray, " N"]]:
        """Pixels and depths of world points; the pixel of a point with depth <= 0 is NaN."""
        local = self.viewmat[:3, :3] @ points + self.viewmat[:3, 3:]
        depth = local[2]
        safe = np.where(depth > 0, depth, np.nan)
        return (self.K @ local)[:2] / safe, depth


def look_at(
    position: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """World to camera of an upright camera at `position` that looks at `target`."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ position
    return viewmat


@dataclass(frozen=True)
class Stand:
    """Where somebody stands who takes the photos, and looks; metres."""

    distance: float = 5.0
    """From the middle of the place, level."""
    sway: float = 0.4
    """How much nearer or farther at most."""
    height: tuple[float, float] = (1.25, 2.1)
    target: tuple[float, float, float] = (0.0, 0.3, 0.95)
    """What the camera looks at."""
    aim: float = 0.15
    """How far it looks past the target at most, along each axis."""


IN_THE_YARD = Stand()


def arc(
    azimuths: Float[np.ndarray, " V"],
    size: tuple[int, int],
    rng: np.random.Generator,
    stand: Stand = IN_THE_YARD,
) -> list[PinholeCamera]:
    """Cameras around the middle of a place at `azimuths` (radians, 0 faces along y).

    Height, distance and target vary a little from camera to camera, as in a hand-held capture.
    """
    width, height = size
    K = np.array([[0.95 * width, 0, width / 2], [0, 0.95 * width, height / 2], [0, 0, 1.0]])
    cameras = []
    for azimuth in azimuths:
        distance = stand.distance + rng.uniform(-stand.sway, stand.sway)
        position = np.array([np.sin(azimuth) * distance, -np.cos(azimuth) * distance, 0.0])
        position[2] = rng.uniform(*stand.height)
        target = np.array(stand.target) + rng.uniform(-stand.aim, stand.aim, 3)
        cameras.append(PinholeCamera(K, look_at(position, target), width, height))
    return cameras
