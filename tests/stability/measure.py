"""One case on one backend: its errors, and how much of the bound they take up."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from desplat_ns.backend import Rendering
from tests.backend.scenes import PARAMETERS, Backend, TestScene, render_reference
from tests.stability.bounds import Bounds, error_bounds
from tests.stability.cases import Case


@dataclass
class Outcome:
    """What came out of one case on one backend."""

    finite: bool
    culled: bool
    """What must not be drawn is not: radius 0, and gradients of exactly 0."""
    drawn: bool
    """What may be drawn was not culled."""
    bound: float
    """Largest relative error that any alpha may have."""
    safe: float
    """Share of pixels that are compared: where nothing lies within rounding of a jump."""
    value_error: float = float("nan")
    """Largest over safe pixels, relative to the largest value of its channel; NaN where the dtype
    cannot hold the scene."""
    value_share: float = float("nan")
    """Largest error as a share of its bound; 1 is the promise."""
    gradient_error: float = float("nan")
    """Largest, relative to the largest gradient by the same parameter."""
    gradient_share: float = float("nan")


def weights(scene: TestScene) -> Tensor:
    """Of pixels and features in the loss whose gradients are compared, [P, F]."""
    rng = torch.Generator().manual_seed(11)
    factor = torch.rand(scene.size[0] * scene.size[1], 5, generator=rng, dtype=torch.float64) - 0.3
    far = (scene.means @ scene.viewmat[2, :3] + scene.viewmat[2, 3]).detach()
    factor[:, 4] /= far.max() if len(far) else 1.0
    return factor


def features(got: Rendering) -> Tensor:
    """Colour, alpha and sum of w z, [P, F]."""
    assert got.depth is not None
    return torch.cat([got.rgb, got.alpha, got.depth * got.alpha], dim=-1).reshape(-1, 5)


def run(case: Case, backend: Backend) -> Outcome:
    """Render and differentiate a case; compare with the float64 reference where the dtype can hold
    the scene."""
    scene = case.drawn
    factor = weights(scene)
    bounds = error_bounds(scene, case.settings, backend.dtype, factor)
    comparable = case.exact_in_float32 or backend.dtype == torch.float64
    if comparable:
        factor = factor * bounds.safe[:, None]
    leaves, got = backend.render(case.make(), case.settings)
    image = features(got)
    (image * factor.to(image)).sum().backward()
    gradients = {name: getattr(leaves, name).grad.cpu() for name in PARAMETERS}
    image = image.detach().cpu()
    keep = [i for i in range(len(leaves.means)) if i not in case.culled]
    gone = list(case.culled)
    outcome = Outcome(
        finite=all(bool(t.isfinite().all()) for t in (image, *gradients.values())),
        culled=bool((got.radii[gone] == 0).all())
        and all(bool((g[gone] == 0).all()) for g in gradients.values()),
        drawn=bool((got.radii[keep] > 0).all()),
        bound=bounds.rho,
        safe=bounds.safe.double().mean().item(),
    )
    if comparable:
        compare(outcome, case, bounds, image, {n: g[keep] for n, g in gradients.items()}, factor)
    return outcome


def compare(
    outcome: Outcome,
    case: Case,
    bounds: Bounds,
    image: Tensor,
    gradients: dict[str, Tensor],
    factor: Tensor,
) -> None:
    """Fill in errors and shares: against `reference.py` and autograd."""
    scene = case.drawn
    exact = render_reference(scene, case.settings)
    want = torch.cat([exact.rgb, exact.alpha, exact.depth * exact.alpha], dim=-1).reshape(-1, 5)
    if want.requires_grad:
        (want * factor).sum().backward()
    want = want.detach()
    error = (image.double() - want).abs() * bounds.safe[:, None]
    outcome.value_share = share(error, bounds.values)
    outcome.value_error = (error / want.abs().amax(0).clamp(min=1e-300)).max().item()
    outcome.gradient_error = outcome.gradient_share = 0.0
    for name in PARAMETERS if len(scene.means) else ():
        true = getattr(scene, name).grad
        off = (gradients[name].double() - true).abs().reshape(len(true), -1).amax(-1)
        outcome.gradient_share = max(outcome.gradient_share, share(off, bounds.gradients[name]))
        relative = (off.max() / true.abs().max().clamp(min=1e-300)).item()
        outcome.gradient_error = max(outcome.gradient_error, relative)


def share(error: Tensor, bound: Tensor) -> float:
    """Largest error / bound; 0 / 0 is 0, and any error over a bound of 0 is infinite."""
    ratio = torch.where(error > 0, error / bound, 0)
    return ratio.max().item() if ratio.numel() else 0.0
