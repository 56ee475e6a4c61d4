"""What every backend does with Gaussians that are broken, extreme, out of view, or not there."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from desplat_ns.backend import RenderSettings
from tests.backend.scenes import PARAMETERS, joined, one_gaussian, random_scene

POISON = {
    "a NaN in the mean": {"means": [[math.nan, 0.0, 2.0]]},
    "a mean beyond float32's square root": {"means": [[1e30, 0.0, 2.0]]},
    "a mean in the camera's centre": {"means": [[0.0, 0.0, 0.0]]},
    "a zero quaternion": {"quats": [[0.0, 0.0, 0.0, 0.0]]},
    "an infinite scale": {"scales": [[math.inf, 0.1, 0.1]]},
    "a scale whose fourth power overflows": {"scales": [[math.exp(40), 0.1, 0.1]]},
    "a NaN opacity": {"opacities": [math.nan]},
    "a NaN colour": {"colors": [[math.nan, 0.0, 0.0]]},
}


@pytest.mark.parametrize("poison", POISON)
def test_a_broken_gaussian_is_not_drawn_and_spoils_nothing(backend, poison):
    settings = RenderSettings(depth=True, absgrad=True, antialiased=True)
    changes = {name: torch.tensor(value) for name, value in POISON[poison].items()}
    healthy = random_scene(29, count=10)
    healthy = dataclasses.replace(healthy, viewmat=torch.eye(4))
    healthy.means = healthy.means + torch.tensor([0.0, 0.0, 2.0])
    behind = one_gaussian(means=torch.tensor([[0.0, 0.0, -2.0]]))
    _, want = backend.render(joined(healthy, behind), settings)
    leaves, got = backend.render(joined(healthy, one_gaussian(**changes)), settings)
    assert got.radii[-1].item() == 0
    assert torch.equal(got.rgb, want.rgb) and torch.equal(got.alpha, want.alpha)
    assert got.depth is not None and want.depth is not None and torch.equal(got.depth, want.depth)
    (got.rgb.sum() + got.alpha.sum() + got.depth.sum()).backward()
    for name in PARAMETERS:
        gradient = getattr(leaves, name).grad
        assert gradient.isfinite().all(), name
        assert gradient[-1].abs().max() == 0, name


def test_no_gaussians_give_an_empty_image_that_can_be_differentiated(backend):
    settings = RenderSettings(depth=True, absgrad=True, antialiased=True)
    empty = {name: getattr(one_gaussian(), name)[:0] for name in PARAMETERS}
    leaves, got = backend.render(one_gaussian(**empty), settings)
    assert got.rgb.shape == (9, 9, 3) and got.alpha.shape == got.depth.shape == (9, 9, 1)
    assert got.means2d.shape == (1, 0, 2) and got.radii.shape == (0,)
    assert got.rgb.abs().max() == got.alpha.max() == got.depth.max() == 0
    (got.rgb.sum() + got.alpha.sum() + got.depth.sum()).backward()
    assert leaves.means.grad.shape == (0, 3)
