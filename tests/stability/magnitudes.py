"""Sizes of everything that a Gaussian's projection is made of, and its rounding in units of u.

u is half of the dtype's epsilon, the error of one rounding. docs/dev/stability.md derives the
formulas. Everything here is float64 arithmetic on magnitudes, so it needs no care of its own.

Letters in shapes: N Gaussians, P pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.constants import EPS2D
from desplat_ns.backend.projection import COMPENSATION_MIN, FOV_MARGIN
from tests.backend.reference import rotations
from tests.backend.scenes import TestScene

OPS = 16
"""Roundings in a chain: camera coordinates (4), quotient and pixel (4), rotation from a quaternion
(10), a covariance or a conic (12), SH (16)."""


@dataclass
class Magnitudes:
    """Sizes of what a Gaussian's projection is made of; [N] or [N, P], float64."""

    slopes: Tensor
    """Rounding of x/z and y/z, in units of u, [N, 2]."""
    row: Tensor
    """Length of a row of J W, pixels per world unit."""
    shift: Tensor
    """Rounding of the projected mean, pixels in units of u, [N, 2]."""
    kappa: Tensor
    """Relative rounding of the conic, in units of u."""
    conic: Tensor
    """Absolute values of the inverse 2D covariance, [N, 2, 2]."""
    pull: Tensor
    """Size of what is added up to d(sigma) / dM, [N, P]."""
    fades: Tensor
    """Size of d log(antialiasing factor) / dM, [N]."""
    lengths: Tensor
    """|a| |b|, the rows of M, pixels^2."""
    size: Tensor
    """|M|, pixels."""
    d: Tensor
    """|pixel - mean|, [N, P, 2]."""
    g: Tensor
    """|conic (pixel - mean)|, [N, P, 2]."""
    sigma: Tensor
    """[N, P]."""
    opacity: Tensor
    """As drawn, [N]."""
    rho: Tensor
    """Relative rounding of alpha, in units of u, [N, P]."""


@dataclass
class Linear:
    """The projection near the mean, and its rounding."""

    mean: Tensor
    """Pixels, [N, 2]."""
    slopes: Tensor
    shift: Tensor
    rows: Tensor
    """J W, [N, 2, 3]."""
    row_size: Tensor
    """Size of what a row of J W is added up from, [N]."""


def linearize(scene: TestScene) -> Linear:
    """Mean and J W of a float64 scene."""
    R, t = scene.viewmat[:3, :3], scene.viewmat[:3, 3]
    place = scene.means @ R.T + t
    sizes = scene.means.abs() @ R.abs().T + t.abs()
    z, z_size = place[:, 2:], sizes[:, 2:] / place[:, 2:]
    focal = torch.stack([scene.K[0, 0], scene.K[1, 1]])
    centre = scene.K[:2, 2]
    slope = place[:, :2] / z
    slopes = sizes[:, :2] / z + slope.abs() * z_size
    mean = focal * slope + centre
    size = torch.tensor(scene.size, dtype=torch.float64)
    beyond = FOV_MARGIN * 0.5 * size / focal
    held = slope.clamp(-(centre / focal + beyond), (size - centre) / focal + beyond)
    rows = (focal / z)[..., None] * (R[:2] - held[..., None] * R[2])
    row_size = rows.norm(dim=-1).amax(-1) * (1 + z_size[:, 0]) + (focal / z * slopes).amax(-1)
    shift = focal * slopes + centre.abs() + mean.abs()
    return Linear(mean, slopes, shift, rows, row_size)


def project(scene: TestScene, settings: RenderSettings) -> Magnitudes:
    """Magnitudes of the projection of a float64 scene."""
    near = linearize(scene)
    M = near.rows @ rotations(scene.quats) * scene.scales[:, None, :]
    low_pass, longer, size = EPS2D, M.norm(dim=-1).amax(-1), M.flatten(1).norm(dim=-1)
    cov = M @ M.mT + low_pass * torch.eye(2, dtype=torch.float64)
    minor = torch.linalg.cross(M[:, 0], M[:, 1]).norm(dim=-1)
    det = minor.square() + low_pass * (size.square() + low_pass)
    conic = torch.stack([cov[:, 1, 1], -cov[:, 0, 1], -cov[:, 0, 1], cov[:, 0, 0]], dim=-1)
    conic = conic.reshape(-1, 2, 2) / det[:, None, None]
    sharpness = conic.diagonal(dim1=-2, dim2=-1).sum(-1)
    # E, the rounding of M = J W R diag(s), pixels in units of u.
    extent = near.row_size * scene.scales.amax(-1) * 3**0.5
    lengths = M[:, 0].norm(dim=-1) * M[:, 1].norm(dim=-1)
    lost = minor * lengths / det

    d = pixel_centres(scene.size) - near.mean[:, None]
    g = torch.einsum("nij,npj->npi", conic, d)
    sigma = 0.5 * (g * d).sum(-1).clamp(min=0)
    g = g.abs()
    form = torch.einsum("npi,nij,npj->np", d.abs(), conic.abs(), d.abs())
    rho = (g * near.shift[:, None]).sum(-1) + (g.sum(-1) * extent[:, None]) * (2 * sigma).sqrt()
    rho = rho + sigma * (1 + lost)[:, None] + form + 1
    pull = sharpness.square()[:, None] * d.square().sum(-1) * size[:, None]
    pull = pull + sharpness.sqrt()[:, None] * form
    opacity, fades = scene.opacities, torch.zeros_like(size)
    if settings.antialiased:
        kept = (minor / det.sqrt()).clamp(min=COMPENSATION_MIN)
        opacity, moves = opacity * kept, kept > COMPENSATION_MIN
        rho = rho + torch.where(moves, 1 + lengths / minor, 1)[:, None]
        fades = torch.where(moves, sharpness.sqrt() + longer / minor, 0)
    return Magnitudes(
        slopes=near.slopes,
        row=near.rows.norm(dim=-1).amax(-1),
        shift=near.shift,
        kappa=1 + lost + 2 * sharpness.sqrt() * extent,
        conic=conic.abs(),
        pull=pull + fades[:, None],
        fades=fades,
        lengths=lengths,
        size=size,
        d=d.abs(),
        g=g,
        sigma=sigma,
        opacity=opacity,
        rho=OPS * rho,
    )


def pixel_centres(size: tuple[int, int]) -> Tensor:
    """[P, 2], row by row."""
    rows, columns = torch.meshgrid(torch.arange(size[1]), torch.arange(size[0]), indexing="ij")
    return torch.stack([columns, rows], dim=-1).reshape(-1, 2).double() + 0.5
