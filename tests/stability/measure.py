"""One case on one backend: its errors, and how much of the bound they take up."""

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
    safe: float
    """Share of pixels that are compared: where nothing lies within rounding of a jump."""
    share: float = float("nan")
    """Largest error of a value or a gradient as a share of its bound; 1 is the promise. NaN where
    the dtype cannot hold the scene."""


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
        safe=bounds.safe.double().mean().item(),
    )
    if comparable:
        kept = {name: gradient[keep] for name, gradient in gradients.items()}
        outcome.share = largest_share(case, bounds, image, kept, factor)
    return outcome


def largest_share(
    case: Case, bounds: Bounds, image: Tensor, gradients: dict[str, Tensor], factor: Tensor
) -> float:
    """Of all errors against `reference.py` and autograd over their bounds; 0 / 0 is 0, and any
    error over a bound of 0 is infinite."""
    scene = case.drawn
    exact = render_reference(scene, case.settings)
    want = torch.cat([exact.rgb, exact.alpha, exact.depth * exact.alpha], dim=-1).reshape(-1, 5)
    if want.requires_grad:
        (want * factor).sum().backward()
    errors = [((image.double() - want.detach()).abs() * bounds.safe[:, None], bounds.values)]
    for name in PARAMETERS if len(scene.means) else ():
        true = getattr(scene, name).grad
        off = (gradients[name].double() - true).abs().reshape(len(true), -1).amax(-1)
        errors.append((off, bounds.gradients[name]))
    shares = [torch.where(error > 0, error / bound, 0) for error, bound in errors]
    return max(share.max().item() for share in shares if share.numel())
