"""Colours before they are cut off at 0: compiled and in torch alike, against float64."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from desplat_ns.backend.projection import view_colors
from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.uncut_colors import uncut_colors

NUM = 90
VIEW = View(torch.eye(4), torch.eye(3), 8, 8)


def splats(dtype: torch.dtype, degree: int = 3) -> tuple[Splats, View]:
    rng = torch.Generator().manual_seed(1)

    def leaf(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=rng).to(dtype).requires_grad_()

    view = View(VIEW.viewmat.to(dtype), VIEW.K.to(dtype), 8, 8)
    opacities = torch.full((NUM,), 0.5, dtype=dtype)
    scales = torch.ones(NUM, 3, dtype=dtype)
    means, quats = leaf(NUM, 3), torch.ones(NUM, 4, dtype=dtype)
    return Splats(means, quats, scales, opacities, leaf(NUM, 16, 3), degree), view


SHOWN = torch.arange(NUM) % 3 > 0


@pytest.mark.parametrize("degree", range(4))
def test_float32_is_as_good_as_float64_allows(degree):
    ours, exact = splats(torch.float32, degree), splats(torch.float64, degree)
    (colors, zeroth), (wanted, zeroth_too) = uncut_colors(*ours, SHOWN), uncut_colors(*exact, SHOWN)
    # Sums of 16 products, of polynomials of degree 3, as in the kernels' own test.
    allowed = 100 * torch.finfo(torch.float32).eps
    assert (colors - wanted).abs().max() <= allowed * wanted.abs().max()
    assert (wanted < 0).any()
    assert torch.equal(zeroth, ours[0].colors[:, 0])
    for result, also, (inputs, _) in ((colors, zeroth, ours), (wanted, zeroth_too, exact)):
        ((result**2).sum() + (also[SHOWN] ** 3).sum()).backward()
        for leaf in (inputs.colors, inputs.means):
            assert leaf.grad is None or (leaf.grad[~SHOWN] == 0).all()
    for name in ("means", "colors") if degree > 0 else ("colors",):
        grad, expected = (getattr(case[0], name).grad for case in (ours, exact))
        nearest = exact[0].means.detach().norm(dim=-1).min()  # gradients grow with 1 / |r|
        worst = allowed * expected.abs().max() * (1 + 1 / nearest)
        assert (grad - expected).abs().max() <= worst, name


def test_cut_off_they_are_the_colours_of_a_view():
    scene, view = splats(torch.float64)
    everyone = torch.ones(NUM, dtype=torch.bool)
    colors = uncut_colors(scene, view, everyone)[0].clamp(min=0)
    assert torch.equal(colors, view_colors(scene, view))


def test_the_camera_gets_its_gradient():
    scene, view = splats(torch.float32)
    viewmat = view.viewmat.clone().requires_grad_()
    colors, _ = uncut_colors(scene, dataclasses.replace(view, viewmat=viewmat), SHOWN)
    torch.testing.assert_close(colors, uncut_colors(scene, view, SHOWN)[0], rtol=1e-4, atol=1e-5)
    (gradient,) = torch.autograd.grad(colors.square().sum(), viewmat)
    assert gradient[:3, 3].abs().min() > 0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_what_is_not_shown_may_be_anything(dtype):
    """Broken coefficients, and a mean in the camera's own place."""
    scene, view = splats(dtype)
    with torch.no_grad():
        scene.colors[0], scene.means[3] = float("nan"), 0.0
    colors, _ = uncut_colors(scene, view, SHOWN)
    assert colors.isfinite().all() and (colors[~SHOWN] == 0).all()
    gradients = torch.autograd.grad(colors.sum(), [scene.means, scene.colors])
    assert all(gradient.isfinite().all() for gradient in gradients)
