"""nerfstudio's cameras as views of a rasterizer."""

import torch
from desplat_ns.data.training_views import train_index
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.rendering.views import view_of, world_to_camera


def looking_along_y() -> torch.Tensor:
    """A camera at (1, 2, 3) that looks along +y with z up, in nerfstudio's (OpenGL) axes."""
    right, up, back = [1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]
    return torch.tensor([[right[i], up[i], back[i], [1.0, 2, 3][i]] for i in range(3)])


def cameras(width: int = 101, height: int = 51, **kwargs) -> Cameras:
    return Cameras(
        camera_to_worlds=looking_along_y()[None],
        fx=80.0,
        fy=90.0,
        cx=50.0,
        cy=25.0,
        width=width,
        height=height,
        **kwargs,
    )


def project(camera: Cameras, point: list[float], downscale: int = 1) -> torch.Tensor:
    view = view_of(camera, downscale=downscale)
    in_camera = view.viewmat @ torch.tensor([*point, 1.0])
    pixel = view.K @ in_camera[:3]
    return pixel[:2] / pixel[2]


def test_what_is_ahead_has_positive_depth():
    ahead = world_to_camera(looking_along_y()) @ torch.tensor([1.0, 7.0, 3.0, 1.0])
    assert torch.allclose(ahead, torch.tensor([0.0, 0.0, 5.0, 1.0]), atol=1e-6)


def test_right_is_right_and_up_is_up_in_the_image():
    assert torch.allclose(project(cameras(), [1, 12, 3]), torch.tensor([50.0, 25.0]))
    # 1 to the right and 2 up at depth 10: x = 50 + 80 / 10, y = 25 - 90 * 2 / 10.
    assert torch.allclose(project(cameras(), [2, 12, 5]), torch.tensor([58.0, 7.0]), atol=1e-5)


def test_the_transform_is_rigid():
    transform = world_to_camera(looking_along_y()).double()
    rotation = transform[:3, :3]
    assert torch.allclose(rotation @ rotation.T, torch.eye(3, dtype=torch.float64))
    assert torch.det(rotation).item() == 1.0


def test_downscaling_halves_pixels_and_rounds_sizes_down():
    view = view_of(cameras(), downscale=2)
    assert (view.width, view.height) == (50, 25)
    assert torch.allclose(project(cameras(), [2, 12, 5], downscale=2), torch.tensor([29.0, 3.5]))


def test_the_camera_itself_is_left_alone():
    camera = cameras()
    view_of(camera, downscale=4)
    assert int(camera.width.item()) == 101
    assert float(camera.fx.item()) == 80.0


def test_only_train_idx_says_which_training_view_a_camera_is():
    assert train_index(cameras()) is None
    assert train_index(cameras(metadata={"cam_idx": 3})) is None
    assert train_index(cameras(metadata={"train_idx": torch.tensor([[7]])})) == 7
