"""The opacity terms of Eq. 5."""

import pytest
import torch
from pytorch_msssim import ssim

from desplat_ns.losses import (
    distractor_opacity_loss,
    mean_shown_opacity,
    photometric_losses,
    static_transparency_loss,
)

FLAT = 1e-5
"""As of tests/backend/test_ssim.py: rounding of float32 images of contrast 0.05 and more."""


def test_values_worked_out_by_hand():
    alpha = torch.tensor([0.0, 0.25, 0.5, 1.0], dtype=torch.float64).reshape(2, 2, 1)
    assert distractor_opacity_loss(alpha).item() == pytest.approx(0.4375, abs=1e-15)
    assert static_transparency_loss(alpha).item() == pytest.approx(0.5625, abs=1e-15)
    where = torch.tensor([1.0, 1.0, 0.5, 1.0], dtype=torch.float64).reshape(2, 2, 1)
    assert static_transparency_loss(alpha, where).item() == pytest.approx(0.5, abs=1e-15)


def test_outside_of_regions_opacity_costs_and_inside_transparency():
    alpha = torch.full((2, 2, 1), 0.8, requires_grad=True)
    inside = torch.tensor([[1.0, 0.0], [0.0, 0.0]])[..., None]
    loss = distractor_opacity_loss(alpha, inside)
    loss.backward()
    assert loss.item() == pytest.approx(0.25 * (3 * 0.8 + 0.2))
    assert alpha.grad is not None
    assert torch.equal(alpha.grad, 0.25 * (1 - 2 * inside))


def test_the_static_loss_of_a_photo_without_distractors_is_splatfactos():
    static, photo = torch.rand(2, 20, 30, 3, generator=torch.Generator().manual_seed(0))
    planes = [x.permute(2, 0, 1)[None] for x in (static, photo)]
    expected = 0.8 * (static - photo).abs().mean() + 0.2 * (1 - ssim(*planes, data_range=1.0))
    for owned in (None, torch.zeros(20, 30, 1)):
        torch.testing.assert_close(photometric_losses(photo, owned, 0.2, static)[0], expected)


@pytest.mark.parametrize("leak", [0.0, 0.1])
def test_owned_pixels_count_by_the_leak_in_l1_and_not_at_all_for_ssim(leak):
    static = torch.rand(30, 40, 3, dtype=torch.float64, requires_grad=True)
    photo = torch.rand(30, 40, 3, dtype=torch.float64)
    owned = torch.zeros(30, 40, 1, dtype=torch.float64)
    owned[5:20, 5:20] = 1.0
    owned[:, 35:] = 0.25
    (loss,) = photometric_losses(photo, owned, 0.0, static, leak=leak)
    loss.backward()
    assert static.grad is not None
    counts = 1 - owned * (1 - leak)
    assert torch.allclose(static.grad.abs(), (counts / 3600).expand(-1, -1, 3), rtol=1e-12)
    assert loss.item() == pytest.approx(((static - photo).abs() * counts).mean().item())
    painted = torch.where(owned == 1, torch.tensor(1.0).double(), photo)
    (again,) = photometric_losses(painted, owned, 1.0, static, leak=leak)
    (loss,) = photometric_losses(photo, owned, 1.0, static, leak=leak)
    assert again.item() == loss.item()


def occluded(height: int, width: int) -> dict[str, torch.Tensor]:
    """A static scene, a photo, and occluders in two corners and where blocks of pixels begin."""
    rng = torch.Generator().manual_seed(1)
    static, photo = torch.rand(2, height, width, 3, generator=rng)
    owned = torch.zeros(height, width, 1)
    owned[2:7, 3:9], owned[-4:, -5:] = 1.0, torch.rand(4, 5, 1, generator=rng)
    owned[16:20, 160:165] = 1.0
    composite = torch.lerp(static, torch.rand(height, width, 3, generator=rng), owned)
    return {"static": static, "composite": composite, "photo": photo, "owned": owned}


@pytest.mark.parametrize("leak", [0.0, 0.03])
@pytest.mark.parametrize("size", [(11, 11), (60, 500), (35, 161)])
def test_two_losses_at_once_are_the_two_by_themselves(size, leak):
    """Compiled against the torch statements in float64; blocks are of 16 x 160 pixels."""
    images = occluded(*size)
    owned = images["owned"]
    losses, slopes = [], []
    for dtype in (torch.float32, torch.float64):
        given = {name: image.to(dtype) for name, image in images.items()}
        static, composite = (given[n].requires_grad_() for n in ("static", "composite"))
        photo, owned = given["photo"], given["owned"]
        pair = photometric_losses(photo, owned, 0.2, static, composite, leak=leak)
        losses.append(torch.stack(pair).double())
        slopes.append(torch.autograd.grad(3 * pair[0] + 2 * pair[1], (static, composite)))
    torch.testing.assert_close(losses[0], losses[1], atol=FLAT, rtol=0)
    largest = slopes[1][0].abs().max()
    assert (slopes[0][0] - slopes[1][0]).abs().max() <= 10 * FLAT * largest
    # Of the composite the distractors alone follow the gradient.
    off = ((slopes[0][1] - slopes[1][1]) * (owned > 0)).abs().max()
    assert off <= 10 * FLAT * slopes[1][1].abs().max()


def test_the_mean_shown_opacity_is_of_what_the_view_shows_and_moves_nothing_else():
    opacities = torch.tensor([[0.0], [1e3], [-1e3]], requires_grad=True)
    mean = mean_shown_opacity(opacities, torch.tensor([True, False, True]))
    mean.backward()
    assert mean.item() == pytest.approx(0.25)
    assert opacities.grad is not None
    assert opacities.grad.flatten().tolist() == pytest.approx([0.125, 0.0, 0.0])
    assert mean_shown_opacity(opacities, torch.zeros(3, dtype=torch.bool)).item() == 0
