"""A Gaussian's contribution is the sum of its blending weights, whatever the backend."""

import pytest
import torch

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import resolve

VIEW = View(torch.eye(4), torch.tensor([[20.0, 0, 16], [0, 20, 12], [0, 0, 1]]), 32, 24)


def splats(opacities: list[float], depths: list[float], side: list[float]) -> Splats:
    n = len(opacities)
    means = torch.stack([torch.tensor(side), torch.zeros(n), torch.tensor(depths)], dim=-1)
    return Splats(
        means=means,
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        scales=torch.full((n, 3), 0.1),
        opacities=torch.tensor(opacities),
        colors=torch.rand(n, 3),
    )


@pytest.fixture(params=["torch", "numba"])
def rasterizer(request):
    return resolve(request.param, "cpu")


def test_what_stands_behind_makes_up_what_is_left(rasterizer):
    both = splats([0.6, 0.9], [2.0, 2.001], [0.0, 0.0])
    front, behind = accumulated_weights(rasterizer, both, VIEW, RenderSettings()).tolist()
    alpha = rasterizer(both, VIEW, RenderSettings()).alpha.sum().item()
    alone = accumulated_weights(rasterizer, splats([0.6], [2.0], [0.0]), VIEW, RenderSettings())
    assert front == pytest.approx(alone.item(), rel=1e-4)
    assert front + behind == pytest.approx(alpha, rel=1e-4)


def test_what_the_view_does_not_show_makes_up_nothing(rasterizer):
    hidden = splats([0.9, 0.9, 0.0], [2.0, -2.0, 3.0], [50.0, 0.0, 0.0])
    sums = accumulated_weights(rasterizer, hidden, VIEW, RenderSettings())
    assert sums.tolist() == [0.0, 0.0, 0.0]


def test_nothing_is_left_behind_in_the_gradients(rasterizer):
    lone = splats([0.7], [2.0], [0.0])
    lone.opacities.requires_grad_()
    with torch.no_grad():
        sums = accumulated_weights(rasterizer, lone, VIEW, RenderSettings(depth=True, absgrad=True))
    assert sums.item() > 0 and not sums.requires_grad
    assert lone.opacities.grad is None


def crowd(seed: int, count: int) -> Splats:
    """Gaussians of some pixels, many of them behind others."""
    rng = torch.Generator().manual_seed(seed)
    z = 1 + 4 * torch.rand(count, generator=rng)
    pixel = torch.rand(count, 2, generator=rng) * torch.tensor([VIEW.width, VIEW.height])
    means = torch.cat([(pixel - VIEW.K[:2, 2]) / 20 * z[:, None], z[:, None]], dim=1)
    return Splats(
        means=means,
        quats=torch.randn(count, 4, generator=rng),
        scales=(0.3 + 2 * torch.rand(count, 3, generator=rng)) / 20 * z[:, None],
        opacities=0.9 + 0.1 * torch.rand(count, generator=rng),
        colors=torch.rand(count, 3, generator=rng),
    )


def test_columns_are_drawn_by_what_contributes_to_them(rasterizer):
    """What contributes nothing may have ended a pixel unseen: before it, blending has left at most
    TRANSMITTANCE_MIN / (1 - ALPHA_MAX), and so much at most shows of what is behind."""
    everything, columns = crowd(0, 300), 14
    whole = rasterizer(everything, VIEW, RenderSettings()).rgb[:, :columns]
    needed = accumulated_weights(rasterizer, everything, VIEW, RenderSettings(), columns) > 0
    assert 0.1 < needed.float().mean() < 0.9
    names = ("means", "quats", "scales", "opacities", "colors")
    fewer = Splats(**{name: getattr(everything, name)[needed] for name in names})
    off = (rasterizer(fewer, VIEW, RenderSettings()).rgb[:, :columns] - whole).abs()
    assert off.max() <= TRANSMITTANCE_MIN / (1 - ALPHA_MAX)
    assert off.mean() < TRANSMITTANCE_MIN
