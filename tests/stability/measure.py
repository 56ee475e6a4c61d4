"""One case on one backend: its errors, and how much of the bound they take up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from desplat_ns.backend import Rendering
from tests.backend.scenes import PARAMETERS, Backend, render_reference
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
    value_error: float
    """Largest over safe pixels, relative to the largest value of its channel."""
    value_share: float
    """Largest error as a share of its bound; 1 is the promise."""
    gradient_error: float
    """Largest, relative to the largest gradient by the same parameter."""
    gradient_share: float
    bound: float
    """Largest relative error that any alpha may have."""
    safe: float
    """Share of pixels that are compared: where nothing lies within rounding of a jump."""


class Truth(Protocol):
    """What a case should give."""

    values: np.ndarray
    """[P, F]."""

    def gradients(self, factor: np.ndarray) -> dict[str, np.ndarray]:
        """Of sum(factor * values), by parameter, [N, components]."""
        ...


class ByFloat64:
    """The truth by `reference.py` and autograd."""

    def __init__(self, case: Case):
        self.scene = case.drawn
        got = render_reference(self.scene, case.settings)
        mass = got.depth * got.alpha
        self.image = torch.cat([got.rgb, got.alpha, mass], dim=-1).reshape(-1, 5)
        self.values = self.image.detach().numpy()

    def gradients(self, factor: np.ndarray) -> dict[str, np.ndarray]:
        if len(self.scene.means) == 0:
            return {name: np.zeros((0, 1)) for name in PARAMETERS}
        for leaf in self.scene.parameters:
            leaf.grad = None
        (self.image * torch.from_numpy(factor)).sum().backward(retain_graph=True)
        count = len(self.scene.means)
        return {
            name: getattr(self.scene, name).grad.reshape(count, -1).numpy() for name in PARAMETERS
        }


truth = cache(ByFloat64)
"""Of a case: values and gradients without the error of float32."""


def weights(case: Case) -> Tensor:
    """Of pixels and features in the loss whose gradients are compared, [P, F]."""
    scene = case.drawn
    pixels = scene.size[0] * scene.size[1]
    rng = torch.Generator().manual_seed(11)
    factor = torch.rand(pixels, 5, generator=rng, dtype=torch.float64) - 0.3
    far = (scene.means @ scene.viewmat[2, :3] + scene.viewmat[2, 3]).detach()
    factor[:, 4] /= far.max() if len(far) else 1.0
    return factor


def features(got: Rendering) -> Tensor:
    """Colour, alpha and sum of w z, [P, F]."""
    assert got.depth is not None
    return torch.cat([got.rgb, got.alpha, got.depth * got.alpha], dim=-1).reshape(-1, 5)


def run(case: Case, backend: Backend, exact: Truth | None = None) -> Outcome:
    """Render and differentiate a case; compare with the truth where the dtype can hold it.

    Args:
        exact: by default `reference.py`, whose float64 rounds as well.
    """
    scene, exact = case.drawn, exact or truth(case)
    comparable = case.exact_in_float32 or backend.dtype == torch.float64
    factor = weights(case)
    bounds = error_bounds(scene, case.settings, backend.dtype, factor)
    if comparable:
        factor = factor * bounds.safe[:, None]
    leaves, got = backend.render(case.make(), case.settings)
    image = features(got)
    (image * factor.to(image)).sum().backward()
    gradients = {name: getattr(leaves, name).grad.cpu() for name in PARAMETERS}
    image = image.detach().cpu()
    finite = all(bool(t.isfinite().all()) for t in (image, *gradients.values()))
    keep = [i for i in range(len(leaves.means)) if i not in case.culled]
    gone = list(case.culled)
    culled = all(bool((g[gone] == 0).all()) for g in gradients.values())
    culled &= bool((got.radii[gone] == 0).all())
    drawn = bool((got.radii[keep] > 0).all())
    safe, nan = bounds.safe.double().mean().item(), float("nan")
    errors = nan, nan, nan, nan
    if comparable:
        errors = compare(exact, bounds, image, {n: g[keep] for n, g in gradients.items()}, factor)
    return Outcome(finite, culled, drawn, *errors, bound=bounds.rho, safe=safe)


def compare(
    exact: Truth,
    bounds: Bounds,
    image: Tensor,
    gradients: dict[str, Tensor],
    factor: Tensor,
) -> tuple[float, float, float, float]:
    """Value error and share, gradient error and share."""
    want = torch.from_numpy(exact.values)
    error = (image.double() - want).abs() * bounds.safe[:, None]
    size = want.abs().amax(0).clamp(min=1e-300)
    value_share = share(error, bounds.values)
    value_error = (error / size).max().item()
    gradient_error = gradient_share = 0.0
    for name, gradient in exact.gradients(factor.numpy()).items():
        true = torch.from_numpy(gradient)
        if true.numel() == 0:
            continue
        off = (gradients[name].double().reshape(true.shape) - true).abs().amax(-1)
        gradient_share = max(gradient_share, share(off, bounds.gradients[name]))
        if true.abs().max() > 0:
            gradient_error = max(gradient_error, (off.max() / true.abs().max()).item())
    return value_error, value_share, gradient_error, gradient_share


def share(error: Tensor, bound: Tensor) -> float:
    """Largest error / bound; 0 / 0 is 0, and any error over a bound of 0 is infinite."""
    ratio = torch.where(error > 0, error / bound, 0)
    return ratio.max().item() if ratio.numel() else 0.0
