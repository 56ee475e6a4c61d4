"""How far from a camera the scene starts, by the reconstruction's points; nearer than a share of
that, a rendering shows nothing: what hangs there contradicts no photo."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.projection import rotation_columns
from desplat_ns.backend.protocol import View
from desplat_ns.cameras.views import image_points, in_image

NEAREST_QUANTILE = 0.01
"""Of the depths of the points in a view; a few points of every reconstruction are astray."""

MAX_POINTS = 100_000
"""Of a larger reconstruction every so many points are looked at."""


def sampled(points: Float[Tensor, "P 3"], most: int = MAX_POINTS) -> Float[Tensor, "Q 3"]:
    """At most so many of the points, in even steps."""
    return points[:: math.ceil(max(1, len(points)) / most)]


def scene_start(points: Float[Tensor, "P 3"], view: View) -> float:
    """Depth at which the points in a view start, world units; 0 where it shows none."""
    u, v, depth = image_points(points, view)
    visible = in_image(u, v, depth)
    return float(depth[visible].quantile(NEAREST_QUANTILE)) if bool(visible.any()) else 0.0


@torch.no_grad()
def stands_clear(
    means: Float[Tensor, "N 3"],
    quats: Float[Tensor, "N 4"],
    scales: Float[Tensor, "N 3"],
    view: View,
    start: float,
    share: float,
) -> Bool[Tensor, " N"]:
    """Which Gaussians do not stand before the camera.

    One does whose centre is nearer than a share of where the scene starts. So does one before that
    start if the camera's plane lies within a standard deviation of its centre: there the
    linearization of EWA has no meaning, and smears what is beside the image over all of it.
    `scales` are standard deviations, `start` is `scene_start` of the view.
    """
    depth = image_points(means, view)[2]
    clear = depth >= share * start
    near = (clear & (depth < start)).nonzero()[:, 0]
    # Standard deviations along the optical axis.
    axis, columns = view.viewmat[2, :3], rotation_columns(quats[near])
    turned = torch.stack([torch.stack(column, dim=-1) @ axis for column in columns], dim=-1)
    return clear.index_put((near,), (turned * scales[near]).norm(dim=-1) < depth[near])
