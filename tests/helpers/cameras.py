"""A camera that looks along +y."""

import torch
from nerfstudio.cameras.cameras import Cameras


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
