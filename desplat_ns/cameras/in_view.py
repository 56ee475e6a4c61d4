"""Which Gaussians a view may show: a cheap test that never leaves out one that is drawn.

A backend draws a Gaussian only where its alpha reaches ALPHA_CUTOFF, so at most REACH_SIGMAS
standard deviations from its mean. With J the Jacobian of the projection, taken at a slope t within
FOV_MARGIN of the image (as all backends clamp it), W the camera's rotation and s the largest scale,

    |J|^2 <= (f / z)^2 (1 + |t|^2),    sigma <= s |J| |W| + sqrt(EPS2D),

f being the longer focal length: J = (f_x (1, 0, -t_x), f_y (0, 1, -t_y)) / z, and I + t t^T has the
eigenvalues 1 and 1 + |t|^2. Everything is compared after it was multiplied by z, so that nothing is
divided.
"""

import math

import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF, EPS2D, FAR_PLANE, NEAR_PLANE
from desplat_ns.backend.projection import FOV_MARGIN, REACH_SIGMAS
from desplat_ns.backend.protocol import Splats, View

MORE_EPS = 0.1
"""Pixels^2. The backends' radius takes the eigenvalues at least sqrt(0.01) from their mean."""

PIXELS = 2.0
"""Added to the reach: radii are rounded up by less than one, and one is for rounding errors."""

ROUNDING = 16
"""Units in the last place by which a camera coordinate may be off: four products, four sums, in any
order, here and in the backend."""

EASE = 1e-3
"""Relative error that is allowed for in a reach or in an opacity: thousands of roundings."""


@torch.no_grad()
def in_view(splats: Splats, view: View) -> Bool[Tensor, " N"]:
    """Which Gaussians may be drawn; those left out show in no pixel, and get no gradient. Each is
    looked at alone, whatever covers it; values that are not finite are left out."""
    rotation, translation = view.viewmat[:3, :3], view.viewmat[:3, 3]
    camera = (rotation @ splats.means.T + translation[:, None]).unbind(0)
    largest = _largest(splats.means) * rotation.abs().sum(1).max() + translation.abs().max()
    off = ROUNDING * torch.finfo(largest.dtype).eps * largest
    z = camera[2]
    shown = (z + off >= NEAR_PLANE) & (z - off <= FAR_PLANE)
    shown &= splats.opacities >= (1 - EASE) * ALPHA_CUTOFF
    sigmas = (1 + EASE) * REACH_SIGMAS * _largest(splats.scales) * _stretch(view)
    blurred = REACH_SIGMAS * math.sqrt(EPS2D + MORE_EPS) + PIXELS
    reach = sigmas + blurred * (z + off)
    for axis, size in ((0, view.width), (1, view.height)):
        focal, center = view.K[axis, axis], view.K[axis, 2]
        place = focal * camera[axis] + center * z
        loose = reach + off * (focal + center.abs() + size)
        shown &= (place + loose >= 0) & (place - size * z - loose <= 0)
    return shown


def _largest(vectors: Tensor) -> Tensor:
    """The largest absolute value of each row of three: `amax` takes several times as long."""
    x, y, z = vectors.abs().T.contiguous().unbind(0)
    return torch.maximum(torch.maximum(x, y), z)


def _stretch(view: View) -> Tensor:
    """A bound [] on z |J| |W|, in pixels: how much longer a length becomes, seen at depth 1."""
    slopes = view.K.new_ones(())
    for axis, size in ((0, view.width), (1, view.height)):
        focal, center = view.K[axis, axis], view.K[axis, 2]
        margin = FOV_MARGIN * 0.5 * size / focal
        low, high = center / focal + margin, (size - center) / focal + margin
        slopes = slopes + torch.maximum(low.abs(), high.abs()).square()
    # |W|^2 is the largest eigenvalue of W W^T, at most its largest sum of absolute values by rows.
    rotation = view.viewmat[:3, :3]
    norm2 = (rotation @ rotation.T).abs().sum(1).max()
    return torch.maximum(view.K[0, 0], view.K[1, 1]) * (slopes * norm2).sqrt()
