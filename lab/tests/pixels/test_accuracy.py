from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from desplat_ns.backend import Rendering, resolve
from desplat_ns.calibration.scenes import make_scene
from lab.pixels.accuracy import FLIP, measure_errors
from lab.pixels.contenders import Contender, backends

SCENE = make_scene(300, 64, 48)


class Wrong:
    """The torch backend with errors of known size: in the value of one pixel, whose gradient is
    then all wrong too, and in every pixel's gradient alone."""

    name = "wrong"

    def __init__(self, pixel: float, scale: float):
        self.pixel, self.scale = pixel, scale

    def __call__(self, splats, view, settings) -> Rendering:
        out = resolve("torch", "cpu")(splats, view, settings)
        # no value, and a gradient
        nothing = (splats.opacities - splats.opacities.detach()).sum()
        at_pixel = torch.zeros_like(out.rgb)
        at_pixel[3, 5, 1] = self.pixel
        wrong = at_pixel * (1 + 1e6 * nothing) + self.scale * nothing
        return replace(out, rgb=out.rgb + wrong)


def errors_of(pixel: float, scale: float):
    (errors,) = measure_errors(SCENE, [Contender("wrong", "cpu", Wrong(pixel, scale))])
    return errors


def test_a_flipped_pixel_is_counted_and_left_out_of_the_gradients():
    errors = errors_of(10 * FLIP, 0.0)
    assert errors.largest == pytest.approx(10 * FLIP, rel=0.01)
    assert errors.flipped == pytest.approx(1 / (64 * 48))
    assert errors.largest_unflipped < FLIP
    assert max(errors.gradients.values()) < 1e-4


def test_a_wrong_gradient_is_found():
    assert errors_of(0.0, 0.0).gradients["opacities"] < 1e-4
    errors = errors_of(0.0, 1e-3)
    assert errors.gradients["opacities"] > 1e-3
    assert errors.gradients["colors"] < 1e-4


def test_every_backend_here_is_within_the_budget():
    """Float32 rounds at 6e-8; 60 Gaussians blend in a pixel, 10 operations each."""
    for errors in measure_errors(SCENE, [c for c in backends()[0] if c.device == "cpu"]):
        assert errors.flipped <= 1 / (64 * 48), errors
        assert max(errors.gradients.values()) < 60 * 10 * 6e-8 * 10, errors
