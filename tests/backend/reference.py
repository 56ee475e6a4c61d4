"""What every backend must compute, in float64, one Gaussian after the other, all pixels at once.

Written from the papers with explicit matrices and shares no code with the package: EWA splatting
(Zwicker et al. 2001), 3D Gaussian Splatting (Kerbl et al. 2023, Eqs. 3-6), Mip-Splatting's 2D
filter (Yu et al. 2024, Eq. 10), the table of real spherical harmonics. The numbers 1/255, 0.999,
1e-4 and 1.3 are gsplat 1.4's. Nothing is culled but what lies out of [NEAR, FAR]; gradients come
from autograd.
"""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import torch
from torch import Tensor

CUTOFF, CLAMP, STOP, FOV = 1 / 255, 0.999, 1e-4, 1.3
NEAR, FAR, LOW_PASS = 0.01, 1e10, 0.3


@dataclass
class Reference:
    rgb: Tensor
    alpha: Tensor
    depth: Tensor
    means2d: Tensor
    """[N, 2]."""
    means2d_per_pixel: Tensor
    """[H * W, N, 2], a copy for each pixel; its gradient tells the pixels apart."""
    sigma_max: Tensor
    """Standard deviation along the longer axis, pixels, [N]."""
    sharpness: float
    """Square root of the largest eigenvalue of an inverse 2D covariance, 1 / pixels."""
    margin: Tensor
    """[H, W]: least relative distance of any alpha or transmittance of the pixel from a place
    where the rules jump."""


@dataclass
class Projection:
    """All Gaussians as one camera has them, none of them culled."""

    means_c: Tensor
    """In the camera's axes, [N, 3]."""
    cov2d: Tensor
    """Widened by LOW_PASS, pixels^2, [N, 2, 2]."""
    conics: Tensor
    """Inverses of `cov2d`."""
    means2d: Tensor
    opacities: Tensor
    """What is left after antialiasing."""
    colors: Tensor
    """Spherical harmonics evaluated, [N, C]."""


def real_sh(degree: int, d: Tensor) -> Tensor:
    """The textbook's table times (-1)^m, the sign that 3DGS uses. [N, (degree + 1)^2]."""
    x, y, z = d.unbind(-1)
    table = [
        [0.5 * sqrt(1 / pi) * torch.ones_like(x)],
        [sqrt(3 / (4 * pi)) * t for t in (y, z, x)],
        [
            0.5 * sqrt(15 / pi) * x * y,
            0.5 * sqrt(15 / pi) * y * z,
            0.25 * sqrt(5 / pi) * (3 * z**2 - 1),
            0.5 * sqrt(15 / pi) * x * z,
            0.25 * sqrt(15 / pi) * (x**2 - y**2),
        ],
        [
            0.25 * sqrt(35 / (2 * pi)) * y * (3 * x**2 - y**2),
            0.5 * sqrt(105 / pi) * x * y * z,
            0.25 * sqrt(21 / (2 * pi)) * y * (5 * z**2 - 1),
            0.25 * sqrt(7 / pi) * (5 * z**3 - 3 * z),
            0.25 * sqrt(21 / (2 * pi)) * x * (5 * z**2 - 1),
            0.25 * sqrt(105 / pi) * (x**2 - y**2) * z,
            0.25 * sqrt(35 / (2 * pi)) * x * (x**2 - 3 * y**2),
        ],
        [
            0.75 * sqrt(35 / pi) * x * y * (x**2 - y**2),
            0.75 * sqrt(35 / (2 * pi)) * y * (3 * x**2 - y**2) * z,
            0.75 * sqrt(5 / pi) * x * y * (7 * z**2 - 1),
            0.75 * sqrt(5 / (2 * pi)) * y * (7 * z**3 - 3 * z),
            3 / 16 * sqrt(1 / pi) * (35 * z**4 - 30 * z**2 + 3),
            0.75 * sqrt(5 / (2 * pi)) * x * (7 * z**3 - 3 * z),
            3 / 8 * sqrt(5 / pi) * (x**2 - y**2) * (7 * z**2 - 1),
            0.75 * sqrt(35 / (2 * pi)) * x * (x**2 - 3 * y**2) * z,
            3 / 16 * sqrt(35 / pi) * (x**2 * (x**2 - 3 * y**2) - y**2 * (3 * x**2 - y**2)),
        ],
    ]
    columns = []
    for n in range(degree + 1):
        columns += [(-1) ** abs(i - n) * term for i, term in enumerate(table[n])]
    return torch.stack(columns, dim=-1)


def rotations(quats: Tensor) -> Tensor:
    """[N, 3, 3] from wxyz: the action q v q* on the three axes."""
    q = quats / quats.norm(dim=-1, keepdim=True)
    w, v = q[:, :1], q[:, 1:]
    columns = []
    for axis in torch.eye(3, dtype=q.dtype):
        e = axis.expand_as(v)
        t = 2 * torch.linalg.cross(v, e)
        columns.append(e + w * t + torch.linalg.cross(v, t))
    return torch.stack(columns, dim=-1)


def covariances2d(means_c: Tensor, sigma3d: Tensor, rotation: Tensor, K: Tensor, size) -> Tensor:
    """J W Sigma W^T J^T, [N, 2, 2], the slopes in J held within 1.3 times the field of view."""
    width, height = size
    z = means_c[:, 2]
    slopes = []
    for axis, extent in ((0, width), (1, height)):
        f, c = K[axis, axis], K[axis, 2]
        beyond = (FOV - 1) * 0.5 * extent / f
        slope = means_c[:, axis] / z
        slopes.append(slope.clamp(-(c / f + beyond).item(), ((extent - c) / f + beyond).item()))
    J = torch.zeros(len(z), 2, 3, dtype=z.dtype)
    J[:, 0, 0], J[:, 0, 2] = K[0, 0] / z, -K[0, 0] * slopes[0] / z
    J[:, 1, 1], J[:, 1, 2] = K[1, 1] / z, -K[1, 1] * slopes[1] / z
    return J @ rotation @ sigma3d @ rotation.T @ J.mT


def sh_colors(means: Tensor, harmonics: Tensor, centre: Tensor, degree: int) -> Tensor:
    """[N, C]: what spherical harmonics show to a camera at `centre`.

    A colour cut at 0 has the gradient of the uncut one where that is negative, else none.
    """
    d = (means - centre) / (means - centre).norm(dim=-1, keepdim=True)
    basis = real_sh(degree, d)
    colors = torch.einsum("nk,nkc->nc", basis, harmonics[:, : basis.shape[1]]) + 0.5
    cut = colors.detach() <= 0
    if colors.requires_grad:
        colors.register_hook(lambda grad: torch.where(cut, grad.clamp(max=0), grad))
    return colors - torch.where(cut, colors.detach(), 0)


def project(scene: Any, antialiased: bool) -> Projection:
    """Of a float64 scene as `scenes.TestScene` has it."""
    rotation, translation = scene.viewmat[:3, :3], scene.viewmat[:3, 3]
    means_c = scene.means @ rotation.T + translation
    R = rotations(scene.quats)
    sigma3d = R @ torch.diag_embed(scene.scales**2) @ R.mT
    sharp = covariances2d(means_c, sigma3d, rotation, scene.K, scene.size)
    cov2d = sharp + LOW_PASS * torch.eye(2, dtype=sharp.dtype)
    conics = torch.linalg.inv(cov2d)
    projected = means_c @ scene.K.T
    means2d = projected[:, :2] / projected[:, 2:]
    opacities, colors = scene.opacities, scene.colors
    if antialiased:
        opacities = opacities * (torch.linalg.det(sharp) / torch.linalg.det(cov2d)).sqrt()
    if scene.sh_degree is not None:
        colors = sh_colors(scene.means, colors, -rotation.T @ translation, scene.sh_degree)
    return Projection(means_c, cov2d, conics, means2d, opacities, colors)


@torch.no_grad()
def least_distance(margin: Tensor, *jumps: tuple[Tensor, float, Tensor]) -> Tensor:
    """The least of `margin` and each value's relative distance from its edge, where relevant."""
    for value, edge, relevant in jumps:
        distance = (value / edge - 1).abs()
        margin = torch.where(relevant, torch.minimum(margin, distance), margin)
    return margin


def composite(gaussians: Projection, size: tuple[int, int]) -> Reference:
    """Blend those between the planes from front to back, each over all pixels."""
    width, height = size
    means_c, dtype = gaussians.means_c, gaussians.means_c.dtype
    drawn = ((means_c[:, 2] >= NEAR) & (means_c[:, 2] <= FAR)).nonzero()[:, 0]
    ys, xs = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([xs, ys], dim=-1).reshape(-1, 2).to(dtype) + 0.5
    per_pixel = gaussians.means2d.expand(len(pixels), -1, -1) * 1.0
    clear = torch.ones(len(pixels), dtype=dtype)
    running = torch.ones(len(pixels), dtype=torch.bool)
    rgb = torch.zeros(len(pixels), gaussians.colors.shape[1], dtype=dtype)
    weight_sum, depth_sum = torch.zeros_like(clear), torch.zeros_like(clear)
    margin = torch.full_like(clear, torch.inf)
    for i in sorted(drawn.tolist(), key=lambda i: (means_c[i, 2].item(), i)):
        d = pixels - per_pixel[:, i]
        power = 0.5 * torch.einsum("pi,ij,pj->p", d, gaussians.conics[i], d)
        raw = gaussians.opacities[i] * torch.exp(-power)
        alpha = raw.clamp(max=CLAMP)
        visible = running & (alpha >= CUTOFF)
        after = clear * (1 - alpha)
        stops = visible & (after <= STOP)
        margin = least_distance(
            margin, (raw, CUTOFF, running), (raw, CLAMP, running), (after, STOP, visible)
        )
        running = running & ~stops
        weight = torch.where(visible & running, alpha * clear, 0)
        clear = torch.where(visible & running, after, clear)
        rgb = rgb + weight[:, None] * gaussians.colors[i]
        weight_sum, depth_sum = weight_sum + weight, depth_sum + weight * means_c[i, 2]
    return Reference(
        rgb=rgb.reshape(height, width, -1),
        alpha=(1 - clear).reshape(height, width, 1),
        depth=(depth_sum / weight_sum.clamp(min=1e-10)).reshape(height, width, 1),
        means2d=gaussians.means2d,
        means2d_per_pixel=per_pixel,
        sigma_max=torch.linalg.eigvalsh(gaussians.cov2d.detach())[:, 1].clamp(min=0).sqrt(),
        sharpness=sharpness(gaussians.conics[drawn]),
        margin=margin.reshape(height, width),
    )


def sharpness(conics: Tensor) -> float:
    """Square root of their largest eigenvalue, 0 of none."""
    return float(torch.linalg.eigvalsh(conics.detach()).max().sqrt()) if len(conics) else 0.0
