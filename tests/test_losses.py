"""The opacity terms of Eq. 5."""

import pytest
import torch

from desplat_ns.losses import distractor_opacity_loss, static_transparency_loss


def test_values_worked_out_by_hand():
    alpha = torch.tensor([0.0, 0.25, 0.5, 1.0], dtype=torch.float64).reshape(2, 2, 1)
    assert distractor_opacity_loss(alpha).item() == pytest.approx(0.4375, abs=1e-15)
    assert static_transparency_loss(alpha).item() == pytest.approx(0.5625, abs=1e-15)


def test_each_pixel_has_the_same_share_of_the_gradient():
    alpha = torch.rand(3, 5, 1, dtype=torch.float64, requires_grad=True)
    (distractor_opacity_loss(alpha) - static_transparency_loss(alpha)).backward()
    assert alpha.grad is not None
    assert torch.allclose(alpha.grad, torch.full_like(alpha, 2 / 15), rtol=0, atol=1e-16)


def test_a_wrong_shape_is_rejected():
    with pytest.raises(Exception, match="alpha_d"):
        distractor_opacity_loss(torch.rand(3, 5))
