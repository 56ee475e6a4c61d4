"""How far from a camera the scene starts, by the reconstruction's points; nearer than a share of
that, a rendering shows nothing.

What hangs before a camera that took no photo contradicts none: three Gaussians that nobody sees in
training can hide a whole new view.
"""

from __future__ import annotations

import math

from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.rendering.views import image_points

NEAREST_QUANTILE = 0.01
"""Of the depths of the points in a view; a few points of every reconstruction are astray."""

MAX_POINTS = 100_000
"""Of a larger reconstruction every so many points are looked at."""


def sampled(points: Float[Tensor, "P 3"], most: int | None = None) -> Float[Tensor, "Q 3"]:
    """At most `most` of the points (`MAX_POINTS`), in even steps."""
    return points[:: math.ceil(max(1, len(points)) / (most or MAX_POINTS))]


def scene_start(points: Float[Tensor, "P 3"], view: View) -> float:
    """Depth at which the points in a view start, world units; 0 where it shows none."""
    u, v, depth = image_points(points, view)
    seen = (depth > 0) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    return float(depth[seen].quantile(NEAREST_QUANTILE)) if bool(seen.any()) else 0.0


def is_beyond(means: Float[Tensor, "N 3"], view: View, near_plane: float) -> Bool[Tensor, " N"]:
    """Which Gaussians have their centre beyond a depth, in world units."""
    return image_points(means.detach(), view)[2] >= near_plane
