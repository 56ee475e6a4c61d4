"""How far rounding may move a rendering and its gradients; docs/dev/stability.md derives the
bounds.

They are of first order in u, half of the dtype's epsilon, the error of one rounding, and count OPS
roundings for every chain of operations. Everything here is float64 arithmetic on magnitudes, so it
needs no care of its own.

Letters in shapes: N Gaussians, P pixels, F features (red, green, blue, 1, depth).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, EPS2D, TRANSMITTANCE_MIN
from desplat_ns.backend.projection import COMPENSATION_MIN, FOV_MARGIN
from tests.backend.reference import rotations
from tests.backend.scenes import PARAMETERS, TestScene

SH_MAX = 1.3
"""No harmonic up to degree 4 exceeds it, nor its slope (degree + 1) times as much."""

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


def project(scene: TestScene, settings: RenderSettings) -> Magnitudes:
    """Magnitudes of the projection of a float64 scene."""
    R, t = scene.viewmat[:3, :3], scene.viewmat[:3, 3]
    place = scene.means @ R.T + t
    sizes = scene.means.abs() @ R.abs().T + t.abs()
    z, z_size = place[:, 2:], sizes[:, 2:] / place[:, 2:]
    focal, centre = scene.K.diagonal()[:2], scene.K[:2, 2]
    slope = place[:, :2] / z
    slopes = sizes[:, :2] / z + slope.abs() * z_size
    mean = focal * slope + centre
    image = torch.tensor(scene.size, dtype=torch.float64)
    beyond = FOV_MARGIN * 0.5 * image / focal
    held = slope.clamp(-(centre / focal + beyond), (image - centre) / focal + beyond)
    rows = (focal / z)[..., None] * (R[:2] - held[..., None] * R[2])  # J W
    # What a row of J W is added up from.
    row_size = rows.norm(dim=-1).amax(-1) * (1 + z_size[:, 0]) + (focal / z * slopes).amax(-1)
    shift = focal * slopes + centre.abs() + mean.abs()
    M = rows @ rotations(scene.quats) * scene.scales[:, None, :]
    low_pass, longer, size = EPS2D, M.norm(dim=-1).amax(-1), M.flatten(1).norm(dim=-1)
    cov = M @ M.mT + low_pass * torch.eye(2, dtype=torch.float64)
    minor = torch.linalg.cross(M[:, 0], M[:, 1]).norm(dim=-1)
    det = minor.square() + low_pass * (size.square() + low_pass)
    conic = torch.stack([cov[:, 1, 1], -cov[:, 0, 1], -cov[:, 0, 1], cov[:, 0, 0]], dim=-1)
    conic = conic.reshape(-1, 2, 2) / det[:, None, None]
    sharpness = conic.diagonal(dim1=-2, dim2=-1).sum(-1)
    # E, the rounding of M = J W R diag(s), pixels in units of u.
    extent = row_size * scene.scales.amax(-1) * 3**0.5
    lengths = M[:, 0].norm(dim=-1) * M[:, 1].norm(dim=-1)
    lost = minor * lengths / det

    width, height = scene.size
    pixels = torch.cartesian_prod(torch.arange(height), torch.arange(width)).flip(-1) + 0.5
    d = pixels.double() - mean[:, None]
    g = torch.einsum("nij,npj->npi", conic, d)
    sigma = 0.5 * (g * d).sum(-1).clamp(min=0)
    g = g.abs()
    form = torch.einsum("npi,nij,npj->np", d.abs(), conic.abs(), d.abs())
    rho = (g * shift[:, None]).sum(-1) + (g.sum(-1) * extent[:, None]) * (2 * sigma).sqrt()
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
        slopes=slopes,
        row=rows.norm(dim=-1).amax(-1),
        shift=shift,
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


@dataclass
class Blend:
    """Front to back; [N, P], rows in the order of the scene, not of depth."""

    weight: Tensor
    """0 where skipped."""
    moves: Tensor
    """Where alpha is drawn and below the clamp."""
    tau: Tensor
    """Relative error of the transmittance in front, absolute (u included)."""
    safe: Tensor
    """[P]: no alpha or transmittance lies within its error of a jump."""


@dataclass
class Bounds:
    """What errors may reach."""

    values: Tensor
    """[P, F]."""
    gradients: dict[str, Tensor]
    """By parameter, [N], for the worst component."""
    safe: Tensor
    """[P]."""


def blend(m: Magnitudes, depths: Tensor, u: float) -> Blend:
    """Weights, and the error of each transmittance."""
    raw = m.opacity[:, None] * torch.exp(-m.sigma)
    rho = u * m.rho
    clear = torch.ones(raw.shape[1], dtype=torch.float64)
    tau, running = torch.zeros_like(clear), torch.ones_like(clear, dtype=torch.bool)
    safe = torch.ones_like(running)
    weight, taus = torch.zeros_like(raw), torch.zeros_like(raw)
    for i in sorted(range(len(depths)), key=lambda i: (float(depths[i]), i)):
        a = raw[i].clamp(max=ALPHA_MAX)
        visible = running & (a >= ALPHA_CUTOFF)
        after = clear * (1 - a)
        own = a * rho[i] / (1 - a) + 2 * u
        for value, edge, error, relevant in (
            (raw[i], ALPHA_CUTOFF, rho[i], running),
            (raw[i], ALPHA_MAX, rho[i], running),
            (after, TRANSMITTANCE_MIN, tau + own, visible),
        ):
            safe &= ~relevant | ((value / edge).log().abs() > error + 4 * u)
        running = running & ~(visible & (after <= TRANSMITTANCE_MIN))
        drawn = visible & running
        taus[i] = tau
        weight[i] = torch.where(drawn, a * clear, 0)
        clear, tau = torch.where(drawn, after, clear), torch.where(drawn, tau + own, tau)
    return Blend(weight, (weight > 0) & (raw < ALPHA_MAX), taus, safe)


@dataclass
class Features:
    """Sizes of red, green, blue, 1 and depth."""

    sizes: Tensor
    """[N, F]."""
    rounding: Tensor
    """In units of u, [N, F]."""
    lost: Tensor
    """Relative rounding of a harmonic, in units of u, [N]."""
    turns: Tensor
    """How a colour moves with the mean, [N]."""


def feature_sizes(scene: TestScene) -> Features:
    """Magnitudes of what is blended."""
    R, t = scene.viewmat[:3, :3], scene.viewmat[:3, 3]
    depth = (scene.means @ R[2] + t[2])[:, None]
    depth_rounding = (scene.means.abs() @ R[2].abs() + t[2].abs())[:, None]
    colors, lost = scene.colors.abs(), torch.zeros(len(depth), dtype=torch.float64)
    turns = torch.zeros_like(lost)
    if scene.sh_degree is not None:
        used = scene.colors[:, : (scene.sh_degree + 1) ** 2].abs().sum(1)
        ray = scene.means + t @ R
        blur = (scene.means.abs() + t.abs() @ R.abs()).amax(-1) / ray.norm(dim=-1)
        lost = OPS * (1 + (scene.sh_degree + 1) * blur)
        colors = 0.5 + SH_MAX * used
        turns = 2 * (scene.sh_degree + 1) * SH_MAX * used.amax(-1) / ray.norm(dim=-1)
    ones = torch.ones_like(depth)
    rounding = torch.cat([colors * lost[:, None], 0 * ones, OPS * depth_rounding], dim=-1)
    return Features(torch.cat([colors, ones, depth], dim=-1), rounding, lost, turns)


@torch.no_grad()
def error_bounds(
    scene: TestScene, settings: RenderSettings, dtype: torch.dtype, factor: Tensor
) -> Bounds:
    """Bounds for a float64 scene whose every Gaussian is drawn, computed in `dtype`.

    Args:
        factor: [P, F]; gradients are those of sum(factor * values), over safe pixels.
    """
    if len(scene.means) == 0:
        nothing = {name: torch.zeros(0) for name in PARAMETERS}
        return Bounds(torch.zeros_like(factor), nothing, torch.ones(len(factor)).bool())
    finfo = torch.finfo(dtype)
    u, tiniest = finfo.eps / 2, finfo.tiny * finfo.eps
    m = project(scene, settings)
    b = blend(m, scene.means @ scene.viewmat[2, :3] + scene.viewmat[2, 3], u)
    f = feature_sizes(scene)
    drawn, rho = b.weight > 0, u * m.rho
    layers = drawn.sum(0)
    largest = (f.sizes[:, None] * drawn[..., None]).amax(0)
    values = torch.einsum("np,nf->pf", b.weight, u * f.rounding)
    values = values + 2 * largest * (b.weight * rho).sum(0)[:, None]
    values = values + 4 * u * (layers + 4 * (layers > 0))[:, None] * largest

    factor = factor.abs() * b.safe[:, None]
    q = (factor * largest).sum(-1)
    q_error = (factor * (f.rounding[:, None] * drawn[..., None]).amax(0)).sum(-1) * u
    sums = 8 * u * (layers + 8)
    # |d loss / d log alpha| <= 2 w q; then its error, and that of what it is multiplied with.
    share = 2 * b.weight * b.moves
    eta = q * (2 * b.tau + 3 * (rho * drawn).amax(0) + sums) + 2 * q_error
    true, computed = jacobians(scene, m)
    gradients = {
        name: (share * (eta * true[name] + OPS * u * q * computed[name])).sum(-1) for name in true
    }
    for name, lost in underflow(scene, m, tiniest).items():
        gradients[name] = gradients[name] + (share * q).sum(-1) * lost
    passed = torch.einsum("np,pf,np->nf", b.weight, factor, rho + b.tau + sums)
    heard = torch.einsum("np,pf->nf", b.weight, factor)
    rgb = slice(3)
    gradients["colors"] = SH_MAX * (passed + u * f.lost[:, None] * heard)[:, rgb].amax(-1)
    gradients["means"] += f.turns * (passed + u * (OPS + f.lost[:, None]) * heard)[:, rgb].sum(-1)
    gradients["means"] += passed[:, 4]
    return Bounds(values, gradients, b.safe)


def jacobians(scene: TestScene, m: Magnitudes) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """Sizes of d log(alpha) / d parameter, true and as it is added up, [N, P]."""
    g = m.g.sum(-1)
    true_pull, pull = g * (2 * m.sigma).sqrt() + m.fades[:, None], m.pull * m.kappa[:, None]
    gains = shape_gains(scene, m)
    true = {name: true_pull * gain[:, None] for name, gain in gains.items()}
    computed = {name: pull * gain[:, None] for name, gain in gains.items()}
    reach = (3 * m.row * (1 + m.slopes.amax(-1)))[:, None]
    steps = torch.einsum("nij,npj->np", m.conic, m.d * m.kappa[:, None, None] + m.shift[:, None])
    true["means"] = true["means"] + g * reach
    computed["means"] = computed["means"] + steps * reach
    true["opacities"] = (1 / scene.opacities.clamp(min=1e-300))[:, None].expand_as(g)
    computed["opacities"] = true["opacities"]
    return true, computed


def shape_gains(scene: TestScene, m: Magnitudes) -> dict[str, Tensor]:
    """How fast M moves with scales, quaternion and (through slope and depth) mean, [N]."""
    z = scene.means @ scene.viewmat[2, :3] + scene.viewmat[2, 3]
    largest = scene.scales.amax(-1)
    return {
        "scales": m.row,
        "quats": 4 * m.row * largest / scene.quats.norm(dim=-1),
        "means": 3 * m.row / z * largest,
    }


def underflow(scene: TestScene, m: Magnitudes, step: float) -> dict[str, Tensor]:
    """What denormal numbers of d sigma / d det leave of the gradients of very large Gaussians."""
    lost = OPS * step * (1 + 2 * m.lengths) * m.size
    return {name: lost * gain for name, gain in shape_gains(scene, m).items()}
