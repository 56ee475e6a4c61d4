"""What a backend checks before it draws: shapes, the camera, and Gaussians that make no sense."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import MAX_DEGREE

MIN_QUAT_NORM = 1e-12
"""Quaternions shorter than this have no direction; their Gaussians are culled. Its square is a
normal float32."""

MAX_CAMERA = 1e8
"""Intrinsics (pixels) and entries of a rotation beyond this are no camera's, and their powers would
overflow float32."""

MIN_FOCAL = 1e-12
"""Pixels. The image's border is size / focal from the axis, which would overflow."""


@torch.no_grad()
def is_finite(splats: Splats) -> Bool[Tensor, " N"]:
    """Gaussians of finite values whose quaternion has a direction; of colours, see `finite_colors`.
    A backend culls the others: they are not drawn, and their gradients are 0."""
    norm2 = splats.quats.square().sum(-1)
    total = splats.means.sum(-1) + splats.scales.sum(-1) + splats.opacities
    good = torch.isfinite(total + norm2) & (norm2 > MIN_QUAT_NORM**2)
    good_colors = finite_colors(splats.colors)
    return good if good_colors is None else good & good_colors


@torch.no_grad()
def finite_colors(
    colors: Float[Tensor, "N 3"] | Float[Tensor, "N K 3"],
) -> Bool[Tensor, " N"] | None:
    """Gaussians whose colours have a finite sum of squares, in float32 up to 1e19: gradients are
    sums of products of colours. On a CPU None if all have, which takes one pass; elsewhere the
    answer would have to be waited for."""
    flat = colors.flatten()
    if colors.is_cpu and math.isfinite(torch.dot(flat, flat).item()):
        return None
    return torch.linalg.vector_norm(colors.flatten(1), dim=-1).isfinite()


def check_inputs(splats: Splats, view: View) -> None:
    """Raises ValueError, with what was found and what is needed, where a tensor does not fit or a
    number of the camera makes no sense. Numbers are looked at on a CPU only: elsewhere they would
    have to be waited for."""
    n = len(splats.means)
    needed = {"means": (n, 3), "quats": (n, 4), "scales": (n, 3), "opacities": (n,)}
    needed |= {"viewmat": (4, 4), "K": (3, 3)}
    given = {k: v for k, v in {**vars(splats), **vars(view)}.items() if isinstance(v, Tensor)}
    for name, shape in needed.items():
        if tuple(given[name].shape) != shape:
            raise ValueError(f"{name} has shape {tuple(given[name].shape)}; needed is {shape}.")
    _check_colors(splats, n)
    for name, tensor in given.items():
        if tensor.dtype != splats.means.dtype or not tensor.dtype.is_floating_point:
            raise ValueError(
                f"{name} is {tensor.dtype} and means is {splats.means.dtype}; "
                "all must have one floating-point dtype."
            )
        if tensor.device != splats.means.device:
            raise ValueError(f"{name} is on {tensor.device}, means on {splats.means.device}.")
    if view.width < 1 or view.height < 1:
        raise ValueError(f"The image is {view.width} x {view.height}; it needs a pixel at least.")
    if view.K.is_cpu:
        _check_camera(view)


def _check_camera(view: View) -> None:
    parts = (view.viewmat[:, :3], view.viewmat[:, 3], view.K)
    rotation, translation, intrinsics = (part.flatten().tolist() for part in parts)
    is_bounded = all(abs(value) <= MAX_CAMERA for value in rotation + intrinsics)
    focal = min(view.K[0, 0].item(), view.K[1, 1].item())
    if not (is_bounded and all(map(math.isfinite, translation)) and focal >= MIN_FOCAL):
        raise ValueError(
            f"No camera has viewmat {view.viewmat.tolist()} and K {view.K.tolist()}: needed are "
            f"numbers of at most {MAX_CAMERA:g} and focal lengths of at least {MIN_FOCAL:g} pixels."
        )


def _check_colors(splats: Splats, n: int) -> None:
    shape, degree = tuple(splats.colors.shape), splats.sh_degree
    if degree is None:
        fits = len(shape) == 2 and shape[1] == 3
        needed = f"({n}, 3), or ({n}, K, 3) with sh_degree set"
    else:
        if degree not in range(MAX_DEGREE + 1):
            raise ValueError(f"sh_degree is {degree}; degrees 0 to {MAX_DEGREE} exist.")
        bases = (degree + 1) ** 2
        fits = len(shape) == 3 and shape[1] >= bases and shape[2] == 3
        needed = f"({n}, K, 3) with K >= {bases}, as sh_degree is {degree}"
    if not fits or shape[0] != n:
        raise ValueError(f"colors has shape {shape}; needed is {needed}.")
