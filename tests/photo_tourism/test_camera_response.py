"""A photo's exposure, white balance, gamma and vignetting, and how they are found."""

import math

import pytest
import torch

from desplat_ns.backend.protocol import View
from desplat_ns.photo_tourism.camera_response import (
    FLOOR,
    OUTLIER,
    camera_response,
    fit_response,
    squared_radius,
)

LIGHT = torch.tensor([0.4, -0.1, -0.3, 0.2, -0.35])
NONE = torch.zeros(5)


def a_view(width: int = 40, height: int = 30) -> View:
    K = torch.tensor([[30.0, 0, width / 2], [0, 30.0, height / 2], [0, 0, 1]])
    return View(torch.eye(4), K, width, height)


def scene(pixels: int = 4000, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    rgb = torch.rand(pixels, 3, generator=generator)
    return rgb, torch.rand(pixels, 1, generator=generator)


def test_each_number_does_what_it_is_called():
    rgb, radius2 = torch.tensor([[0.2, 0.4, 0.6]]), torch.tensor([[0.5]])
    torch.testing.assert_close(camera_response(rgb, torch.zeros(5), radius2), rgb)
    red = camera_response(rgb, torch.tensor([math.log(2), 0, 0, 0, 0]), radius2)
    torch.testing.assert_close(red, torch.tensor([[0.4, 0.4, 0.6]]))
    darker = camera_response(rgb, torch.tensor([0, 0, 0, 0, math.log(0.25)]), radius2)
    torch.testing.assert_close(darker, rgb / 2)
    steeper = camera_response(rgb, torch.tensor([0, 0, 0, math.log(2), 0]), radius2)
    torch.testing.assert_close(steeper, (rgb + FLOOR) ** 2 - FLOOR**2)


def test_the_radius_is_0_at_the_principal_point_and_1_in_the_corners():
    radius2 = squared_radius(a_view())
    assert radius2.shape == (30, 40, 1)
    assert radius2.max() == pytest.approx(1, abs=0.06)
    assert radius2.min() < 1e-3
    assert radius2[0, 0] == radius2[-1, -1] == radius2[0, -1]
    half = squared_radius(a_view(20, 15))  # a smaller photo of the same kind
    assert half[3, 4].item() == pytest.approx(radius2[6:8, 8:10].mean().item(), abs=2e-3)


def test_gradients_are_right_down_to_black():
    rgb, radius2 = (x[:8].double() for x in scene())
    rgb[0], rgb[1] = 0.0, 1.5
    numbers = LIGHT.double().requires_grad_()
    assert torch.autograd.gradcheck(
        lambda a, b: camera_response(a, b, radius2), (rgb.requires_grad_(), numbers)
    )


def test_a_light_is_found_from_the_colours():
    rgb, radius2 = scene()
    photo = camera_response(rgb, LIGHT, radius2).clamp(0, 1)
    assert ((photo == 1).float().mean()) > 0.02  # some of it is overexposed
    torch.testing.assert_close(fit_response(rgb, photo, radius2, NONE), LIGHT, atol=2e-3, rtol=0)


def test_what_stands_in_front_does_not_set_the_light():
    rgb, radius2 = scene()
    photo = camera_response(0.6 * rgb, LIGHT, radius2).clamp(0, 1)
    photo[: len(photo) // 4] = torch.tensor([0.9, 0.1, 0.1])
    fitted = fit_response(0.6 * rgb, photo, radius2, NONE)
    torch.testing.assert_close(fitted, LIGHT, atol=0.06, rtol=0)


def test_a_dark_thing_at_the_border_is_not_taken_for_vignetting():
    """Its pixels, two fifths, fit one light, and all others one like the scene's."""
    rgb, radius2 = scene()
    photo = camera_response(0.6 * rgb, 0.2 * LIGHT, radius2).clamp(0, 1)
    covered = radius2[:, 0] > radius2.quantile(0.6)
    seen = photo[~covered]
    photo[covered] = torch.tensor([0.05, 0.06, 0.04])
    shown = camera_response(0.6 * rgb, fit_response(0.6 * rgb, photo, radius2, NONE), radius2)
    torch.testing.assert_close(shown.clamp(0, 1)[~covered], seen, atol=OUTLIER / 2, rtol=0)


def test_what_the_scene_does_not_show_is_no_light():
    """The photo shows other things than the scene: their differences are no vignetting or gamma."""
    (rgb, radius2), (other, _) = scene(60), scene(60, seed=1)
    photo = 0.5 * other.repeat_interleave(50, dim=0)
    fitted = fit_response(
        0.5 * rgb.repeat_interleave(50, dim=0), photo, radius2.repeat(50, 1), NONE
    )
    assert fitted.abs().max() < 0.1


def test_a_black_or_overexposed_photo_and_one_without_pixels_have_the_mean_light():
    rgb, radius2 = scene()
    for level in (0.0, 1.0):
        assert torch.equal(fit_response(rgb, torch.full_like(rgb, level), radius2, LIGHT), LIGHT)
    assert torch.equal(fit_response(rgb[:0], rgb[:0], radius2[:0], LIGHT), LIGHT)


def test_the_corners_that_a_lens_darkens_in_all_photos_stay_dark_where_the_photo_is_noisy():
    lens = torch.tensor([0.0, 0.0, 0.0, 0.0, -0.5])
    rgb, radius2 = scene()
    noise = 0.1 * torch.randn(rgb.shape, generator=torch.Generator().manual_seed(2))
    photo = (camera_response(0.8 * rgb, lens, radius2) + noise).clamp(0, 1)
    assert fit_response(0.8 * rgb, photo, radius2, lens)[4] == pytest.approx(-0.5, abs=0.06)
