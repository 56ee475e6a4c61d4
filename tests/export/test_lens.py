"""What a pinhole shows is put where the lens shows it; OpenCV's projection says where that is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.export.lens import pinhole_of

K = np.array([[60.0, 0, 41], [0, 58, 33], [0, 0, 1]])
WIDTH, HEIGHT = 80, 64


def lens(kind: CameraType, *distortion: float) -> Cameras:
    """k1, k2, k3, k4, p1, p2."""
    return Cameras(
        torch.eye(4)[None, :3],
        K[0, 0],
        K[1, 1],
        K[0, 2],
        K[1, 2],
        WIDTH,
        HEIGHT,
        torch.tensor([distortion]),
        torch.tensor([[kind.value]]),
    )


def project(kind: CameraType, distortion: tuple[float, ...], point: np.ndarray) -> np.ndarray:
    """Where OpenCV's lens model shows a point, in pixels from the image's corner."""
    k1, k2, k3, k4, p1, p2 = distortion
    place, zero = point.reshape(1, 1, 3), np.zeros(3)
    if kind == CameraType.FISHEYE:
        pixels, _ = cv2.fisheye.projectPoints(place, zero, zero, K, np.array([k1, k2, k3, k4]))
    else:
        pixels, _ = cv2.projectPoints(place, zero, zero, K, np.array([k1, k2, p1, p2, k3]))
    return pixels.reshape(2)


@pytest.mark.parametrize(
    ("kind", "distortion"),
    [
        (CameraType.PERSPECTIVE, (0.12, -0.05, 0.01, 0.0, 0.004, -0.003)),
        (CameraType.PERSPECTIVE, (-0.25, 0.06, 0.0, 0.0, 0.0, 0.0)),
        (CameraType.FISHEYE, (0.05, -0.01, 0.002, 0.0, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize("point", [(0.0, 0.0), (0.45, 0.3), (-0.5, 0.4), (0.55, -0.45)])
def test_a_disc_in_the_pinhole_is_found_where_the_lens_shows_it(
    kind: CameraType, distortion: tuple[float, ...], point: tuple[float, float]
):
    pinhole = pinhole_of(lens(kind, *distortion))
    matrix = pinhole.camera.get_intrinsics_matrices()[0].numpy()
    place = matrix[:2, :2] @ point + matrix[:2, 2]
    height, width = int(pinhole.camera.height), int(pinhole.camera.width)
    rows, columns = np.mgrid[:height, :width] + 0.5
    squared = (columns - place[0]) ** 2 + (rows - place[1]) ** 2
    disc = np.exp(-squared / 8).astype(np.float32)
    photo = pinhole.to_photo(disc)
    assert photo.shape == (HEIGHT, WIDTH)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    middle = np.array([(photo * columns).sum(), (photo * rows).sum()]) / photo.sum()
    expected = project(kind, distortion, np.array([*point, 1.0]))
    assert np.abs(middle - expected).max() < 0.15, "the disc of 2 pixels is bent by a tenth"


def test_the_whole_photo_is_seen():
    pinhole = pinhole_of(lens(CameraType.PERSPECTIVE, -0.25, 0.06, 0.0, 0.0, 0.0, 0.0))
    shape = int(pinhole.camera.height), int(pinhole.camera.width)
    assert np.allclose(pinhole.to_photo(np.ones(shape, np.float32)), 1)


def test_without_distortion_nothing_moves():
    image = np.random.default_rng(0).random((HEIGHT, WIDTH)).astype(np.float32)
    pinhole = pinhole_of(lens(CameraType.PERSPECTIVE, *[0.0] * 6))
    assert pinhole.to_photo(image) is image
