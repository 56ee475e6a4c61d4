"""Hard inputs for the formulas outside of the rasterizers, in float32: values and gradients.

Each has a closed form, evaluated in float64, and a bound in roundings.
"""

import torch
from torch import Tensor

from desplat_ns.gaussians.activation import (
    MAX_LOG_SCALE,
    activate_distractors,
    activate_static,
    sigmoid,
)
from desplat_ns.layers import over_background
from desplat_ns.losses import photometric_losses

U = torch.finfo(torch.float32).eps / 2
"""The error of one rounding."""

TINY = torch.finfo(torch.float32).tiny
SSIM_C1, SSIM_C2 = 1e-4, 9e-4
"""0.01^2 and 0.03^2 (Wang et al. 2004)."""

SSIM_ERROR = 22 * U / SSIM_C2
"""Bound on the SSIM of images whose variance is 0, from docs/dev/stability.md."""


def assert_within(
    output: Tensor, leaf: Tensor, value: Tensor, slope: Tensor, *bounds: Tensor | float
):
    """Hold an output to its value, and the gradient of its sum by a leaf to its slope."""
    (got_slope,) = torch.autograd.grad(output.sum(), leaf)
    for got, want, bound in ((output, value, bounds[0]), (got_slope, slope, bounds[1])):
        assert got.isfinite().all()
        assert ((got.detach().double() - want).abs() <= bound).all()


def test_nearly_opaque_distractors_leave_their_share_to_what_is_behind():
    alpha = torch.tensor([0.0, 0.5, 0.999, 1 - 2.0**-20, 1 - U, 1.0]).reshape(-1, 1, 1)
    front = (alpha * 0.75).expand(-1, 1, 3)
    behind = torch.full((6, 1, 3), 0.625, requires_grad=True)
    clear = (1 - alpha.double()).expand(-1, 1, 3)
    got = over_background(front, alpha, behind)
    # 1 - alpha, the product and the sum are rounded; 1 - alpha is exact where alpha >= 1/2.
    assert_within(got, behind, front.double() + clear * 0.625, clear, 3 * U, U * clear)


def test_opacity_logits_may_lie_far_out():
    logits = torch.tensor([-1e30, -1e4, -90, -20, -1, -0.0, 0, 1, 20, 90, 1e4, 1e30, float("inf")])
    exact = torch.sigmoid(logits.double())
    slope = exact * torch.sigmoid(-logits.double())
    assert_within(sigmoid(logits.requires_grad_()), logits, exact, slope, 6 * U, 8 * U)


def test_log_scales_may_lie_far_out_and_learn_nothing_above_their_limit():
    """exp, of which gradients are as large as values: both bounds are relative."""
    raw = torch.tensor([[-1e4, -200.0, -88.0], [-40.0, 0.0, 40.0], [79.0, 89.0, 1e4]])
    raw.requires_grad_()
    shapes = {"means": (3, 3), "quats": (3, 4), "opacities": (3, 1), "features_dc": (3, 3)}
    params = {name: torch.ones(shape) for name, shape in shapes.items()}
    params |= {"scales": raw, "features_rest": torch.zeros(3, 0, 3), "rgbs": torch.zeros(3, 3)}
    want = raw.detach().double().clamp(max=MAX_LOG_SCALE).exp()
    slope = torch.where(raw.detach() > MAX_LOG_SCALE, 0.0, want)
    for splats in (activate_static(params, 0), activate_distractors(params)):
        assert_within(splats.scales, raw, want, slope, 4 * U * want + TINY, 4 * U * slope + TINY)


def test_flat_images_have_an_ssim_and_a_gradient():
    """Without variance, SSIM = (2 a b + C1) / (a^2 + b^2 + C1); the gradients of its pixels sum up
    to the derivative by a."""
    for a, b in ((0.0, 0.0), (1.0, 1.0), (0.5, 0.25), (0.0, 1.0), (1e-3, 2e-3)):
        level = torch.tensor(a, requires_grad=True)
        image = level.expand(13, 15, 3).contiguous()
        value = 1 - photometric_losses(torch.full((13, 15, 3), b), None, 1.0, image)[0]
        x, y = level.detach().double(), torch.tensor(b).double()
        top, bottom = 2 * x * y + SSIM_C1, x * x + y * y + SSIM_C1
        slope = (2 * y * bottom - 2 * x * top) / bottom**2
        # A gradient divides by a mean square or a variance once more: at most 1 / C1 or 1 / C2.
        allowed = SSIM_ERROR * (slope.abs() + 2 / SSIM_C2)
        assert_within(value, level, top / bottom, slope, SSIM_ERROR, allowed)
