"""From 3D Gaussians to what a rasterizer draws: EWA splatting in plain, component-wise torch.

Works for any float dtype and device and knows nothing of tiles. Conventions are those of gsplat's
CUDA kernels: pixel centres at +0.5, the Jacobian's field of view clamped at 1.3 times the image's.

Culled Gaussians are replaced, before anything is divided or normalized, by a harmless one in front
of the camera. Masking the results would be too late: 0 * inf in the backward pass is NaN.
"""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF, EPS2D, FAR_PLANE, NEAR_PLANE
from desplat_ns.backend.gsplat_build import unavailable_reason
from desplat_ns.backend.inputs import check_inputs, finite_colors, is_finite
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.spherical_harmonics import sh_basis

FOV_MARGIN = 0.3
"""The Jacobian is taken at most this share of half the image beyond its border (3DGS, gsplat):
further out the affine approximation explodes."""

REACH_SIGMAS = math.sqrt(2 * math.log(1 / ALPHA_CUTOFF))
"""Standard deviations (3.33) beyond which even an opaque Gaussian is below ALPHA_CUTOFF."""

MAX_PIXELS = 1e8
"""Gaussians that spread further than this, or lie further off the axis, are culled: det(cov2d) is
their fourth power and float32 ends at 3e38."""

COMPENSATION_MIN = 1e-3
"""Floor of the antialiasing factor, whose slope is infinite at 0. It is below ALPHA_CUTOFF, so what
it changes is never drawn."""


@dataclass(frozen=True)
class ProjectedSplats:
    """Gaussians on the image plane of one view, in pixels. Entries of culled ones mean nothing."""

    means2d: Float[Tensor, "1 N 2"]
    conics: Float[Tensor, "N 3"]
    """xx, xy, yy of the inverse 2D covariance, pixels^-2."""
    depths: Float[Tensor, " N"]
    """Along the optical axis, world units."""
    opacities: Float[Tensor, " N"]
    """Compensated where the settings ask for antialiasing."""
    colors: Float[Tensor, "N 3"]
    """Evaluated for this view, >= 0 where they come from spherical harmonics."""
    radii: Int[Tensor, " N"]
    """3 sigma of the longer axis, rounded up; 0 where culled."""


def project(splats: Splats, view: View, settings: RenderSettings) -> ProjectedSplats:
    """Project Gaussians, evaluate their colours and cull those out of [NEAR_PLANE, FAR_PLANE], off
    the image, with values that are not finite, with a quaternion of length 0, or larger than
    MAX_PIXELS; their gradients are 0. Differentiable in `splats` and in `view`. Raises ValueError:
    shapes, dtypes or devices do not fit together; a camera that cannot be."""
    check_inputs(splats, view)
    usable = _usable(splats, view)
    splats = _with_culled_replaced(splats, view, usable)

    x, y, z = _to_camera(splats.means, view).unbind(-1)
    focal_x, focal_y, center_x, center_y = _intrinsics(view)
    mean_x, mean_y = focal_x * x / z + center_x, focal_y * y / z + center_y
    cov_xx, cov_xy, cov_yy, det_sharp = _cov2d(splats, view, x, y, z)
    cov_xx, cov_yy = cov_xx + EPS2D, cov_yy + EPS2D
    det = det_sharp + EPS2D * (cov_xx + cov_yy - EPS2D)

    means2d = torch.stack([mean_x, mean_y], dim=-1)
    # Rounded up, the diagonal keeps every conic positive definite in this dtype: of a needle's
    # xx * yy - xy^2 nothing but rounding is left, and an indefinite one would grow without bound.
    up = 1 + 4 * torch.finfo(det.dtype).eps
    opacities = splats.opacities
    if settings.antialiased:
        ratio = (det_sharp / det).clamp(min=COMPENSATION_MIN**2)
        opacities = opacities * ratio.sqrt()
    colors = splats.colors
    if splats.sh_degree is not None:
        colors = cut_at_zero(_sh_colors(splats.means - view.center, colors, splats.sh_degree))
    return ProjectedSplats(
        means2d=means2d[None],
        conics=torch.stack([up * cov_yy / det, -cov_xy / det, up * cov_xx / det], dim=-1),
        depths=z,
        opacities=opacities,
        colors=colors,
        radii=_radii(usable, means2d, (cov_xx, cov_xy, cov_yy), view),
    )


def cut_at_zero(colors: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
    """max(c, 0). A colour that is cut gets the gradients against which a step makes it lighter:
    with none, what is black in all views would stay black for ever."""
    return _CutAtZero.apply(colors)  # type: ignore[return-value]


class _CutAtZero(torch.autograd.Function):
    @staticmethod
    def forward(ctx, colors):  # type: ignore[override]
        ctx.save_for_backward(colors)
        return colors.clamp(min=0)

    @staticmethod
    def backward(ctx, grad):  # type: ignore[override]
        (colors,) = ctx.saved_tensors
        return torch.where(colors > 0, grad, grad.clamp(max=0))


def uncut_colors(
    splats: Splats, view: View, shown: Bool[Tensor, " N"]
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 3"]]:
    """SH + 1/2 seen from `view`, negative ones too, which Eq. 7 of DeSplat tones; 0, without
    gradients, where not `shown`. And the zeroth coefficients of all. Float32 by numba's kernels on
    a CPU and gsplat's on CUDA, else in plain torch. Differentiable in the camera."""
    assert splats.sh_degree is not None
    center = view.center
    means, coefficients = splats.means, splats.colors
    is_float32 = means.dtype == coefficients.dtype == torch.float32
    if is_float32 and means.is_cuda and unavailable_reason() is None:
        from gsplat import spherical_harmonics

        colors = spherical_harmonics(splats.sh_degree, means - center, coefficients, masks=shown)
        # Rows that are not shown hold whatever was in the memory.
        return torch.where(shown[:, None], colors + 0.5, 0.0), coefficients[:, 0]
    if is_float32 and means.is_cpu and not center.requires_grad:
        from desplat_ns.backend.numba_kernels.sh import EvaluateColors

        return EvaluateColors.apply(
            means, coefficients, shown.int(), center, splats.sh_degree, False
        )  # type: ignore[return-value]
    # Replaced before the length is divided by: 0 * inf in the backward pass is NaN.
    away = torch.where(shown[:, None], means - center, 1.0)
    used = coefficients.masked_fill(~shown[:, None, None], 0)
    colors = _sh_colors(away, used, splats.sh_degree)
    return colors.masked_fill(~shown[:, None], 0), coefficients[:, 0]


def _sh_colors(away: Tensor, coefficients: Tensor, degree: int) -> Tensor:
    """SH + 1/2 [N, 3] along `away` [N, 3], which may have any length."""
    basis = sh_basis(degree, torch.nn.functional.normalize(away, dim=-1))
    return torch.einsum("nk,nkc->nc", basis, coefficients[:, : basis.shape[-1]]) + 0.5


def _intrinsics(view: View) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    return view.K[0, 0], view.K[1, 1], view.K[0, 2], view.K[1, 2]


def _to_camera(means: Tensor, view: View) -> Tensor:
    return means @ view.viewmat[:3, :3].T + view.viewmat[:3, 3]


@torch.no_grad()
def _usable(splats: Splats, view: View) -> Bool[Tensor, " N"]:
    """Sound Gaussians in front, of bounded size: comparisons with NaN are False."""
    camera = _to_camera(splats.means, view)
    z = camera[:, 2]
    pixels = torch.maximum(view.K[0, 0], view.K[1, 1]) / z.clamp(min=NEAR_PLANE)
    spread = torch.maximum(camera[:, :2].abs().amax(-1), splats.scales.abs().amax(-1)) * pixels
    usable = is_finite(splats) & (spread < MAX_PIXELS)
    return usable & (z >= NEAR_PLANE) & (z <= FAR_PLANE)


def _with_culled_replaced(splats: Splats, view: View, usable: Tensor) -> Splats:
    """The same set with a unit Gaussian, one unit in front of the camera, for each culled one."""
    culled = ~usable[:, None]
    rotation, translation = view.viewmat[:3, :3].detach(), view.viewmat[:3, 3].detach()
    ahead = (rotation.new_tensor([0.0, 0.0, 1.0]) - translation) @ rotation
    colors = splats.colors
    if finite_colors(colors) is not None:
        colors = colors.masked_fill(culled if colors.ndim == 2 else culled[..., None], 0)
    return replace(
        splats,
        means=torch.where(culled, ahead, splats.means),
        quats=splats.quats.masked_fill(culled, 0.5),
        scales=splats.scales.masked_fill(culled, 1),
        opacities=splats.opacities.masked_fill(~usable, 0),
        colors=colors,
    )


def rotation_columns(quats: Tensor) -> list[list[Tensor]]:
    """The rotation matrix of quaternions wxyz of any length, as nine vectors [N]: [row][column]."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1, eps=0.0).T.contiguous().unbind(0)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def _cov2d(
    splats: Splats, view: View, x: Tensor, y: Tensor, z: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """xx, xy, yy and the determinant of J W Sigma W^T J^T, pixels^2: Eq. 5 of the 3DGS paper.

    With M = J W R diag(s), 2 x 3, the determinant of M M^T is the sum of M's squared 2 x 2 minors
    (Cauchy-Binet): never negative and free of the cancellation in xx * yy - xy^2.
    """
    focal_x, focal_y, center_x, center_y = _intrinsics(view)
    x_over_z = _clamped_slope(x / z, focal_x, center_x, view.width)
    y_over_z = _clamped_slope(y / z, focal_y, center_y, view.height)
    world = view.viewmat[:3, :3]
    rotation = rotation_columns(splats.quats)
    scales = splats.scales.T.contiguous().unbind(0)
    rows = []
    for axis, slope, focal in ((0, x_over_z, focal_x), (1, y_over_z, focal_y)):
        # A row of J W: how this pixel coordinate moves with the world position.
        row = [focal / z * (world[axis, j] - slope * world[2, j]) for j in range(3)]
        rows.append([sum(row[j] * rotation[j][k] for j in range(3)) * scales[k] for k in range(3)])
    (a0, a1, a2), (b0, b1, b2) = rows
    minors = (a0 * b1 - a1 * b0, a1 * b2 - a2 * b1, a2 * b0 - a0 * b2)
    return (
        a0 * a0 + a1 * a1 + a2 * a2,
        a0 * b0 + a1 * b1 + a2 * b2,
        b0 * b0 + b1 * b1 + b2 * b2,
        minors[0] * minors[0] + minors[1] * minors[1] + minors[2] * minors[2],
    )


def _clamped_slope(slope: Tensor, focal: Tensor, center: Tensor, size: int) -> Tensor:
    """x / z kept within the image and FOV_MARGIN beyond, as in gsplat's `persp_proj`."""
    margin = FOV_MARGIN * 0.5 * size / focal
    return torch.minimum(
        torch.maximum(slope, -(center / focal + margin)), (size - center) / focal + margin
    )


@torch.no_grad()
def _radii(
    usable: Tensor, means2d: Tensor, cov2d: tuple[Tensor, Tensor, Tensor], view: View
) -> Int[Tensor, " N"]:
    """3 sigma of the longer axis, rounded up; 0 where culled or out of the image's reach."""
    xx, xy, yy = cov2d
    # b^2 - det of gsplat's formula, written without its cancellation.
    spread = (((xx - yy) / 2).square() + xy.square()).clamp(min=0.01)
    sigma = ((xx + yy) / 2 + spread.sqrt()).sqrt()
    radii = (3.0 * sigma).ceil()
    reach = torch.maximum(radii, REACH_SIGMAS * sigma)[:, None]
    size = means2d.new_tensor([view.width, view.height])
    touches = ((means2d + reach > 0) & (means2d - reach < size)).all(dim=-1)
    return torch.where(usable & touches, radii, 0.0).to(torch.int32)
