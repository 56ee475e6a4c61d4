"""nerfstudio's cameras as views of a rasterizer."""

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.backend.protocol import View
from desplat_ns.cameras.views import resized, view_of
from desplat_ns.core.errors import ConfigError


def cameras() -> Cameras:
    """One at (1, 2, 3) that looks along +y with z up, in nerfstudio's (OpenGL) axes."""
    right, up, back, place = [1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0], [1.0, 2, 3]
    return Cameras(torch.tensor([right, up, back, place]).T[None], 80.0, 90.0, 50.0, 25.0, 101, 51)


def project(view: View, point: list[float]) -> torch.Tensor:
    in_camera = view.viewmat @ torch.tensor([*point, 1.0])
    pixel = view.K @ in_camera[:3]
    return pixel[:2] / pixel[2]


def test_right_is_right_and_up_is_up_in_the_image():
    assert torch.allclose(project(view_of(cameras()), [1, 12, 3]), torch.tensor([50.0, 25.0]))
    # 1 to the right and 2 up at depth 10: x = 50 + 80 / 10, y = 25 - 90 * 2 / 10.
    assert torch.allclose(
        project(view_of(cameras()), [2, 12, 5]), torch.tensor([58.0, 7.0]), atol=1e-5
    )


def test_a_point_is_at_the_same_share_of_a_smaller_image():
    view = view_of(cameras())
    whole, smaller = (project(each, [2, 12, 5]) for each in (view, resized(view, (50, 10))))
    assert torch.allclose(smaller, whole * torch.tensor([50 / 101, 10 / 51]))


def test_cameras_of_other_kinds_are_not_drawn_as_pinholes():
    camera = cameras()
    for kind in (CameraType.FISHEYE, CameraType.EQUIRECTANGULAR, CameraType.VR180_L):
        camera.camera_type = torch.full_like(camera.camera_type, kind.value)
        with pytest.raises(ConfigError, match=kind.name):
            view_of(camera)
