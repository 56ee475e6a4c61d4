"""Colours before they are cut off at 0: compiled and in torch alike, against float64."""

import dataclasses

import pytest
import torch

from desplat_ns.backend.projection import uncut_colors
from desplat_ns.backend.protocol import Splats, View

NUM = 90

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)]


def splats(dtype: torch.dtype, degree: int = 3, device: str = "cpu") -> tuple[Splats, View]:
    rng = torch.Generator().manual_seed(1)

    def leaf(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=rng).to(device, dtype).requires_grad_()

    def eye(size: int) -> torch.Tensor:
        return torch.eye(size, dtype=dtype, device=device)

    means, ones = leaf(NUM, 3), torch.ones(NUM, 4, dtype=dtype, device=device)
    drawn = Splats(means, ones, ones[:, :3], ones[:, 0], leaf(NUM, 16, 3), degree)
    return drawn, View(eye(4), eye(3), 8, 8)


SHOWN = torch.arange(NUM) % 3 > 0


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("degree", [0, 3])
def test_float32_is_as_good_as_float64_allows(degree, device):
    ours, exact = splats(torch.float32, degree, device), splats(torch.float64, degree, device)
    shown = SHOWN.to(device)
    (colors, zeroth), (wanted, zeroth_too) = uncut_colors(*ours, shown), uncut_colors(*exact, shown)
    # Sums of 16 products, of polynomials of degree 3, as in the kernels' own test.
    allowed = 100 * torch.finfo(torch.float32).eps
    assert (colors - wanted).abs().max() <= allowed * wanted.abs().max()
    assert (wanted < 0).any()
    assert torch.equal(zeroth, ours[0].colors[:, 0])
    for result, also, (inputs, _) in ((colors, zeroth, ours), (wanted, zeroth_too, exact)):
        ((result**2).sum() + (also[shown] ** 3).sum()).backward()
        for leaf in (inputs.colors, inputs.means):
            assert leaf.grad is None or (leaf.grad[~shown] == 0).all()
    for name in ("means", "colors") if degree > 0 else ("colors",):
        grad, expected = (getattr(case[0], name).grad for case in (ours, exact))
        nearest = exact[0].means.detach().norm(dim=-1).min()  # gradients grow with 1 / |r|
        worst = allowed * expected.abs().max() * (1 + 1 / nearest)
        assert (grad - expected).abs().max() <= worst, name


def test_the_camera_gets_its_gradient():
    scene, view = splats(torch.float32)
    viewmat = view.viewmat.clone().requires_grad_()
    colors, _ = uncut_colors(scene, dataclasses.replace(view, viewmat=viewmat), SHOWN)
    torch.testing.assert_close(colors, uncut_colors(scene, view, SHOWN)[0], rtol=1e-4, atol=1e-5)
    (gradient,) = torch.autograd.grad(colors.square().sum(), viewmat)
    assert gradient[:3, 3].abs().min() > 0


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_what_is_not_shown_may_be_anything(dtype, device):
    """Broken coefficients, and a mean in the camera's own place."""
    (scene, view), shown = splats(dtype, device=device), SHOWN.to(device)
    with torch.no_grad():
        scene.colors[0], scene.means[3] = float("nan"), 0.0
    colors, _ = uncut_colors(scene, view, shown)
    assert colors.isfinite().all() and (colors[~shown] == 0).all()
    gradients = torch.autograd.grad(colors.sum(), [scene.means, scene.colors])
    assert all(gradient.isfinite().all() for gradient in gradients)
