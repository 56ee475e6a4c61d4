"""How a rendering and its gradients are compared with the float64 reference.

Pixels where an alpha or a transmittance lies within rounding of a jump (cutoff, clamp, stop) may
go either way; they are left out of the comparison and of the loss, and there may be few of them.
"""

from __future__ import annotations

import torch
from torch import Tensor

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import (
    PARAMETERS,
    Backend,
    TestScene,
    gradient_tolerance,
    render_reference,
    tolerance,
)

FLIP_BUDGET = 0.1
"""Share of pixels that may lie within rounding of a jump."""


def check_forward(backend: Backend, scene: TestScene, settings: RenderSettings) -> None:
    want = render_reference(scene.to(torch.float64), settings)
    _, got = backend.render(scene, settings)
    allowed = tolerance(backend.dtype, scene.size, want.sharpness)
    safe = want.margin > allowed
    assert safe.double().mean() >= 1 - FLIP_BUDGET
    difference = {
        "rgb": (got.rgb.cpu() - want.rgb) / max(1.0, want.rgb.max().item()),
        "alpha": got.alpha.cpu() - want.alpha,
    }
    if got.depth is not None:
        far = want.depth.max().clamp(min=1e-10)
        # The quotient of two sums: an error relative to their weight.
        weight = want.alpha.clamp(max=1)
        difference["depth"] = 0.5 * (got.depth.cpu() - want.depth) * weight / far
    for name, error in difference.items():
        assert error.abs()[safe].max() <= allowed, name


def check_gradients(backend: Backend, scene: TestScene, settings: RenderSettings) -> None:
    """Compare the gradients of a random linear functional of colour, alpha and depth."""
    truth = scene.to(torch.float64)
    want = render_reference(truth, settings)
    want.means2d.retain_grad()
    allowed = tolerance(backend.dtype, scene.size, want.sharpness)
    safe = (want.margin > allowed)[..., None]
    assert safe.double().mean() >= 1 - FLIP_BUDGET
    leaves, got = backend.render(scene, settings)
    rng = torch.Generator().manual_seed(7)
    for name in ("rgb", "alpha", "depth"):
        image = getattr(want, name)
        factor = torch.rand(image.shape, generator=rng, dtype=torch.float64) - 0.3
        # An expected depth has no slope bound where next to nothing is drawn.
        factor = factor * safe * (want.alpha.detach() > 0.02)
        (image * factor).sum().backward(retain_graph=True)
        part = getattr(got, name)
        (part * factor.to(part)).sum().backward(retain_graph=name != "depth")

    for name in PARAMETERS:
        check_close(name, getattr(leaves, name).grad, getattr(truth, name).grad, allowed)
    assert got.means2d.grad is not None
    check_close("means2d", got.means2d.grad[0], want.means2d.grad, allowed)


def check_close(name: str, got: Tensor | None, want: Tensor | None, allowed: float) -> None:
    assert got is not None and want is not None, name
    error = (got.cpu().double() - want).abs().max()
    assert error <= gradient_tolerance(allowed) * want.abs().max(), name
