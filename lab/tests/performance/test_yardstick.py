from __future__ import annotations

import math

import pytest
import torch

from desplat_ns.backend import Rasterizer, RenderSettings, Splats, View, resolve
from desplat_ns.calibration.scenes import PARAMETERS, make_scene, tensors_of
from lab.performance.yardstick import YARDSTICK, Yardstick
from lab.performance.yardstick_squares import SquaresYardstick
from lab.pixels.accuracy import measure_errors
from lab.pixels.contenders import cotangents, images_of

SETTINGS = RenderSettings(depth=True)


def images_and_gradients(rasterizer: Rasterizer, scene, dtype: torch.dtype):
    splats = scene.splats(dtype)
    images = images_of(rasterizer(splats, scene.view_as(dtype), SETTINGS))
    return images, torch.autograd.grad(images, tensors_of(splats), cotangents(images))


@pytest.mark.parametrize("size", [(400, 70, 45), (60, 16, 16), (3, 5, 1)])
def test_the_yardstick_agrees_with_the_torch_backend_in_value_and_gradient(size):
    scene = make_scene(*size)
    images, grads = images_and_gradients(Yardstick(), scene, torch.float64)
    exact, exact_grads = images_and_gradients(resolve("torch", "cpu"), scene, torch.float64)
    # float64 rounds at 1e-16; sums over 400 Gaussians and 3150 pixels, conditions up to 1e3
    for image, wanted in zip(images, exact, strict=True):
        assert torch.allclose(image, wanted, rtol=1e-9, atol=1e-11)
    for name, grad, wanted in zip(PARAMETERS, grads, exact_grads, strict=True):
        assert (grad - wanted).abs().max() <= 1e-9 * wanted.abs().max(), name


def test_two_gaussians_blend_as_worked_out_by_hand():
    """Alpha 0.5 in front of 0.8 at a pixel's centre; both have variance 1 + 0.3 pixels^2."""
    splats = Splats(
        means=torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 4.0]]),
        quats=torch.tensor([[1.0, 0, 0, 0], [1.0, 0, 0, 0]]),
        scales=torch.tensor([[0.125] * 3, [0.25] * 3]),
        opacities=torch.tensor([0.5, 0.8]),
        colors=torch.tensor([[1.0, 0, 0], [0, 1.0, 0]]),
    )
    K = torch.tensor([[16.0, 0, 4.5], [0, 16.0, 4.5], [0, 0, 1]])
    out = Yardstick()(splats, View(torch.eye(4), K, 9, 9), SETTINGS)
    assert torch.allclose(out.rgb[4, 4], torch.tensor([0.5, 0.4, 0.0]), atol=1e-6)
    assert out.alpha[4, 4].item() == pytest.approx(0.9, abs=1e-6)
    assert out.depth is not None
    assert out.depth[4, 4].item() == pytest.approx((0.5 * 2 + 0.4 * 4) / 0.9, abs=1e-5)
    # one pixel aside both have fallen to exp(-1 / (2 * 1.3))
    fall = math.exp(-1 / 2.6)
    assert out.rgb[4, 5, 0].item() == pytest.approx(0.5 * fall, abs=1e-6)


def test_nothing_is_drawn_without_gaussians():
    scene = make_scene(1, 20, 20)
    scene.params["opacities"].fill_(-20.0)
    out = Yardstick()(scene.splats(), scene.view, SETTINGS)
    assert out.rgb.shape == (20, 20, 3) and out.rgb.abs().max() == 0


def test_on_squares_only_what_lies_beyond_3_sigma_is_missing():
    scene = make_scene(400, 70, 45)
    exact = Yardstick()(scene.splats(), scene.view, SETTINGS)
    squares = SquaresYardstick()(scene.splats(), scene.view, SETTINGS)
    # An opaque Gaussian still has exp(-4.5) = 0.011 there.
    assert (exact.alpha - squares.alpha).abs().max() <= 0.011
    faint = scene.splats()
    faint = Splats(faint.means, faint.quats, faint.scales, 0.3 * faint.opacities, faint.colors, 3)
    got, wanted = (y(faint, scene.view, SETTINGS) for y in (SquaresYardstick(), Yardstick()))
    assert torch.allclose(got.rgb, wanted.rgb, atol=1e-6)  # 0.3 exp(-4.5) is below the cutoff


def test_in_float32_it_is_as_exact_as_the_backends_have_to_be():
    """Float32 rounds at 6e-8; 60 Gaussians blend in a pixel, 10 operations each."""
    (errors,) = measure_errors(make_scene(300, 64, 48), [YARDSTICK])
    assert errors.flipped <= 1 / (64 * 48)
    assert max(errors.gradients.values()) < 60 * 10 * 6e-8 * 10
