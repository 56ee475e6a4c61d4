"""The background: rays, Eq. 8 to 11, and what their gradients reach."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from desplat_ns.backend.protocol import View
from desplat_ns.backend.spherical_harmonics import sh_basis
from desplat_ns.losses import background_opacity_loss, explained_by_background
from desplat_ns.photo_tourism.background import NODES, background_image, rays


def view(width: int = 5, height: int = 4) -> View:
    K = torch.tensor([[3.0, 0.0, 2.5], [0.0, 4.0, 2.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    angle = 0.3
    viewmat = torch.eye(4, dtype=torch.float64)
    cos, sin = math.cos(angle), math.sin(angle)
    viewmat[:3, :3] = torch.tensor([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    viewmat[:3, 3] = torch.tensor([0.1, -0.2, 0.3])
    return View(viewmat, K, width, height)


def test_rays_project_to_the_centres_of_their_pixels():
    camera = view()
    x, y = torch.arange(5).double() + 0.5, torch.arange(4).double() + 0.5
    through = rays(camera, x, y)
    centre = -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
    points = centre + 7.0 * through
    in_camera = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    pixels = in_camera @ camera.K.T
    pixels = pixels[..., :2] / pixels[..., 2:]
    v, u = torch.meshgrid(torch.arange(4) + 0.5, torch.arange(5) + 0.5, indexing="ij")
    torch.testing.assert_close(pixels, torch.stack([u, v], dim=-1).double())
    torch.testing.assert_close(through.norm(dim=-1), torch.ones(4, 5, dtype=torch.float64))


def test_gradients_of_the_background():
    coefficients = 0.05 * torch.randn(25, 3, dtype=torch.float64)
    assert gradcheck(lambda b: background_image(b, view(), 4), [coefficients.requires_grad_()])


def by_its_own_rays(camera: View, coefficients: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The background of degree 4 with a ray for each pixel, and as it is drawn, [pixels, 3]."""
    x, y = (torch.arange(n).double() + 0.5 for n in (camera.width, camera.height))
    exact = sh_basis(4, rays(camera, x, y).reshape(-1, 3)) @ coefficients + 0.5
    return exact.clamp(0, 1), background_image(coefficients, camera, 4).reshape(-1, 3)


def test_a_small_picture_is_exact_and_between_the_nodes_a_large_one_errs_by_little():
    """Against the harmonics of every pixel's own ray; each side may add what NODES says."""
    generator = torch.Generator().manual_seed(0)
    coefficients = 0.1 * torch.randn(25, 3, dtype=torch.float64, generator=generator)
    exact, image = by_its_own_rays(view(), coefficients)
    torch.testing.assert_close(image, exact)
    width, height = 301, 203
    K = torch.tensor([[250.0, 0, 140], [0, 260.0, 90], [0, 0, 1]], dtype=torch.float64)
    exact, image = by_its_own_rays(View(view().viewmat, K, width, height), coefficients)
    error, angle = (image - exact).abs().max(), width / NODES / 250
    assert error < 2 * angle**2 * 4 * 5 / 8 * coefficients.abs().sum(dim=0).max()
    assert exact.std() > 0.05


def test_pixels_count_as_explained_by_six_of_nine_neighbours():
    """5 of 9 are 0.56, 6 of 9 are 0.67: the threshold 0.6 lies between."""
    background = torch.zeros(5, 5, 3)
    photo = torch.ones(5, 5, 3)
    neighbours = [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2)]
    for row, column in neighbours:
        photo[row, column] = 0
    assert not explained_by_background(background, photo, 0.003)[2, 2]
    photo[3, 3] = 0
    assert explained_by_background(background, photo, 0.003)[2, 2]


def test_the_error_may_reach_the_threshold_and_is_a_mean_over_channels():
    background, photo = torch.zeros(3, 3, 3, requires_grad=True), torch.zeros(3, 3, 3)
    photo[..., 0] = 0.75
    explained = explained_by_background(background, photo, 0.25)
    assert explained[1, 1] and not explained.requires_grad
    assert not explained_by_background(background, photo, 0.2499)[1, 1]


def test_the_loss_is_the_mean_composite_opacity_where_the_background_explains_the_photo():
    """All but the last of 4 x 4 pixels' columns is as the background. Of the pixels at the border
    six neighbours are in the picture, and four of those in a corner: P is eight pixels."""
    photo = torch.zeros(4, 4, 3, dtype=torch.float64)
    photo[:, 3] = 1.0
    explained = explained_by_background(torch.zeros_like(photo), photo, 0.003)
    rows = [[0, 1, 0, 0], [1, 1, 1, 0], [1, 1, 1, 0], [0, 1, 0, 0]]
    assert explained[..., 0].int().tolist() == rows
    alpha_d, alpha_s = torch.zeros(2, 4, 4, 1, dtype=torch.float64)
    alpha_d[1], alpha_s[:, 1], alpha_s[:, 3] = 0.2, 0.5, 0.9
    # Column 1: 0.5, and 0.2 + 0.8 * 0.5 in row 1; in that row 0.2 on either side of it.
    expected = (3 * 0.5 + 0.6 + 2 * 0.2) / 8
    assert float(background_opacity_loss(alpha_d, alpha_s, explained)) == pytest.approx(expected)


def test_the_loss_pulls_at_both_opacities():
    alphas = [torch.rand(4, 5, 1, dtype=torch.float64).requires_grad_() for _ in range(2)]
    explained = torch.rand(4, 5, 1) > 0.5
    assert gradcheck(lambda d, s: background_opacity_loss(d, s, explained), alphas)
    grads = torch.autograd.grad(background_opacity_loss(alphas[0], alphas[1], explained), alphas)
    for grad in grads:
        assert (grad[explained] > 0).all()
        assert (grad[~explained] == 0).all()
    assert background_opacity_loss(alphas[0], alphas[1], torch.zeros_like(explained)) == 0
