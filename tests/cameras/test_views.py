"""nerfstudio's cameras as views of a rasterizer."""

from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.cameras.views import view_of
from desplat_ns.core.errors import ConfigError
from tests.helpers.cameras import cameras


def project(camera: Cameras, point: list[float], size: Any = None) -> torch.Tensor:
    view = view_of(camera, size_of=size)
    in_camera = view.viewmat @ torch.tensor([*point, 1.0])
    pixel = view.K @ in_camera[:3]
    return pixel[:2] / pixel[2]


def test_right_is_right_and_up_is_up_in_the_image():
    assert torch.allclose(project(cameras(), [1, 12, 3]), torch.tensor([50.0, 25.0]))
    # 1 to the right and 2 up at depth 10: x = 50 + 80 / 10, y = 25 - 90 * 2 / 10.
    assert torch.allclose(project(cameras(), [2, 12, 5]), torch.tensor([58.0, 7.0]), atol=1e-5)


def test_a_point_is_at_the_same_share_of_a_smaller_image():
    camera = cameras()

    def size(width: int, height: int) -> tuple[int, int]:
        return width // 2, height // 5

    view = view_of(camera, size_of=size)
    assert (view.width, view.height) == (50, 10)
    assert int(camera.width.item()) == 101  # it is left alone
    whole, smaller = project(cameras(), [2, 12, 5]), project(cameras(), [2, 12, 5], size)
    assert torch.allclose(smaller, whole * torch.tensor([50 / 101, 10 / 51]))


def test_cameras_of_other_kinds_are_not_drawn_as_pinholes():
    camera = cameras()
    for kind in (CameraType.FISHEYE, CameraType.EQUIRECTANGULAR, CameraType.VR180_L):
        camera.camera_type = torch.full_like(camera.camera_type, kind.value)
        with pytest.raises(ConfigError, match=kind.name):
            view_of(camera)
