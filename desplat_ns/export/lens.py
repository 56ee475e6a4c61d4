"""Renderings are made through a pinhole; photos on disk were taken through a lens.

Letters in shapes: H x W pixels of the photo, h x w of the pinhole's image.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.rendering.views import is_distorted

WIDEST = 5.0
"""Tangent of the angle from the optical axis beyond which a pinhole is not drawn (79 degrees)."""

MARGIN = 1
"""Pixels around what is seen, for interpolation at the border."""

CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
"""When inverting a lens model stops; OpenCV's default of 5 rounds is off by pixels in corners."""


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera that sees what a photo shows, and where the photo's pixels are in it."""

    camera: Cameras
    """[1]"""
    places: Float[np.ndarray, "H W 2"] | None
    """x and y of the photo's pixel centres in the pinhole's image, from its corner, in pixels; None
    where they are the same pixels."""

    def to_photo(self, image: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "H W"]:
        """An image of the pinhole's as the lens shows it; 0 where the pinhole sees nothing."""
        if self.places is None:
            return image
        x, y = np.moveaxis(self.places.astype(np.float32) - 0.5, -1, 0)
        return cv2.remap(image, x, y, cv2.INTER_LINEAR)


def pinhole_of(camera: Cameras) -> Pinhole:
    """The pinhole that sees all that the photo of a camera [1] shows, at the same focal lengths."""
    if not is_distorted(camera):
        return Pinhole(camera, None)
    rays = _slopes(camera)
    rays = np.where(np.isfinite(rays) & (np.abs(rays) <= WIDEST), rays, np.nan)
    least, most = np.nanmin(rays, axis=(0, 1)), np.nanmax(rays, axis=(0, 1))
    focal = np.array([float(camera.fx), float(camera.fy)])
    cx, cy = center = MARGIN - least * focal
    width, height = np.ceil((most - least) * focal).astype(int) + 2 * MARGIN
    pinhole = Cameras(
        camera.camera_to_worlds,
        camera.fx,
        camera.fy,
        float(cx),
        float(cy),
        int(width),
        int(height),
    )
    return Pinhole(pinhole, np.nan_to_num(rays * focal + center, nan=-2.0))


def _slopes(camera: Cameras) -> Float[np.ndarray, "H W 2"]:
    """x / z and y / z of the rays through the photo's pixel centres, in OpenCV's axes."""
    height, width = int(camera.height), int(camera.width)
    rows, columns = np.mgrid[:height, :width]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2) + 0.5
    matrix = camera.get_intrinsics_matrices()[0].double().numpy()
    assert camera.distortion_params is not None
    k1, k2, k3, k4, p1, p2 = camera.distortion_params[0].double().tolist()
    if int(camera.camera_type) == CameraType.FISHEYE.value:
        lens = np.array([k1, k2, k3, k4])
        slopes = cv2.fisheye.undistortPoints(pixels, matrix, lens, criteria=CRITERIA)
    else:
        lens = np.array([k1, k2, p1, p2, k3])
        slopes = cv2.undistortPointsIter(pixels, matrix, lens, np.eye(3), np.eye(3), CRITERIA)
    return slopes.reshape(height, width, 2)
