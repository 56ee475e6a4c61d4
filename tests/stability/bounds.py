"""How far rounding may move a rendering and its gradients; docs/dev/stability.md derives the
bounds.

They are of first order in u, and count OPS roundings for every chain of operations.

Letters in shapes: N Gaussians, P pixels, F features (red, green, blue, 1, depth).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from tests.backend.scenes import PARAMETERS, TestScene
from tests.stability.magnitudes import OPS, Magnitudes, project

SH_MAX = 1.3
"""No harmonic up to degree 4 exceeds it, nor its slope (degree + 1) times as much."""


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
    rho: float
    """Largest relative error of an alpha that is drawn."""


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
        return Bounds(torch.zeros_like(factor), nothing, torch.ones(len(factor)).bool(), 0.0)
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
    return Bounds(values, gradients, b.safe, float((rho * drawn).max()))


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
