"""What every backend does with Gaussians that are broken or extreme."""

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
