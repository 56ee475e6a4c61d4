"""From nerfstudio's cameras to the view that a rasterizer takes."""

import cv2
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Shaped
from nerfstudio.cameras.cameras import Cameras, CameraType
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.core.errors import ConfigError


def world_to_camera(camera_to_world: Float[Tensor, "3 4"]) -> Float[Tensor, "4 4"]:
    """Rigid world-to-camera transform in OpenCV axes (z forward, y down, as rasterizers have it),
    of a camera-to-world one in OpenGL axes (-z forward, y up, as nerfstudio)."""
    rotation = torch.cat([camera_to_world[:, :1], -camera_to_world[:, 1:3]], dim=1).T
    translation = -rotation @ camera_to_world[:, 3:]
    last_row = torch.eye(4, dtype=rotation.dtype, device=rotation.device)[3:]
    return torch.cat([torch.cat([rotation, translation], dim=1), last_row])


def is_distorted(cameras: Cameras) -> bool:
    """Whether the lens of any camera bends what a pinhole shows straight; a fisheye does without
    terms of distortion."""
    distortion = cameras.distortion_params
    bends = distortion is not None and bool(torch.any(distortion != 0))
    return bends or bool(torch.any(cameras.camera_type == CameraType.FISHEYE.value))


def view_of(camera: Cameras, camera_to_world: Float[Tensor, "3 4"] | None = None) -> View:
    """The view of a single camera (shape [1]). `camera_to_world` replaces the camera's own pose
    where a pose optimizer moved it.

    Raises ConfigError of a camera of another kind, as a path of ns-render may have it. A photo's
    fisheye was undistorted and has its terms still; that of a path has none.
    """
    pose = camera.camera_to_worlds[0] if camera_to_world is None else camera_to_world
    intrinsics = camera.get_intrinsics_matrices()[0].to(pose)
    numbers = torch.cat([camera.width, camera.height, camera.camera_type])
    width, height, kind = numbers.flatten().tolist()
    is_photo = kind == CameraType.FISHEYE.value and camera.distortion_params is not None
    if kind != CameraType.PERSPECTIVE.value and not is_photo:
        raise ConfigError(
            f"A camera of the kind {CameraType(kind).name} cannot be drawn, only perspective ones. "
            "Make a camera path of perspective cameras."
        )
    return View(world_to_camera(pose), intrinsics, width, height)


def resized(view: View, size: tuple[int, int]) -> View:
    """The same view in an image of another (width, height)."""
    if size == (view.width, view.height):
        return view
    scale = view.K.new_tensor([[size[0] / view.width], [size[1] / view.height], [1.0]])
    return View(view.viewmat, view.K * scale, *size)


def reduced(image: Shaped[Tensor, "H W C"], size: tuple[int, int]) -> Shaped[Tensor, "h w C"]:
    """An image at a smaller (width, height), each pixel the mean of the area that it covers. On a
    GPU the result is float32."""
    if image.is_cpu:
        smaller = cv2.resize(image.numpy(), size, interpolation=cv2.INTER_AREA)
        return torch.from_numpy(smaller.reshape(size[1], size[0], -1))
    channels = image.permute(2, 0, 1).to(torch.float32)
    return F.adaptive_avg_pool2d(channels, (size[1], size[0])).permute(1, 2, 0)


def views_of(cameras: Cameras) -> list[View]:
    return [view_of(cameras[i : i + 1]) for i in range(len(cameras))]


def image_points(
    means: Float[Tensor, "N 3"], view: View
) -> tuple[Float[Tensor, " N"], Float[Tensor, " N"], Float[Tensor, " N"]]:
    """Where points are seen: x and y as shares of the image's width and height, and their depth.
    Places of points behind the camera (depth below 0) mean nothing."""
    # one row for each coordinate: a third of the time of one for each point
    x, y, z = (view.viewmat[:3, :3] @ means.T + view.viewmat[:3, 3:]).unbind(0)
    u = (x / z * view.K[0, 0] + view.K[0, 2]) / view.width
    v = (y / z * view.K[1, 1] + view.K[1, 2]) / view.height
    return u, v, z


def in_image(
    u: Float[Tensor, " N"], v: Float[Tensor, " N"], depth: Float[Tensor, " N"]
) -> Bool[Tensor, " N"]:
    """Which of the places that `image_points` gives lie before the camera and inside its image."""
    return (depth > 0) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
