from __future__ import annotations

import torch

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.projection import project
from desplat_ns.calibration.scenes import PARAMETERS, make_scene


def test_the_same_call_makes_the_same_scene():
    first, second = make_scene(100, 64, 48), make_scene(100, 64, 48)
    assert all(torch.equal(first.params[name], second.params[name]) for name in first.params)


def test_a_fifth_of_the_gaussians_has_its_centre_outside():
    scene = make_scene(5000, 480, 270)
    with torch.no_grad():
        x, y = project(scene.splats(), scene.view, RenderSettings()).means2d[0].unbind(-1)
    inside = ((x > 0) & (x < 480) & (y > 0) & (y < 270)).double().mean()
    # the deviation of a share of 5000 draws is 0.006
    assert abs(float(inside) - 0.8) < 0.03


def test_leaves_are_float32_numbers_in_any_dtype():
    splats = make_scene(50, 64, 48).splats(torch.float64)
    for name in PARAMETERS:
        value = getattr(splats, name)
        assert value.is_leaf and value.requires_grad
        assert torch.equal(value, value.float().double())
