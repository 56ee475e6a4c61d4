"""A Gaussian's contribution is the sum of its blending weights, whatever the backend."""

import pytest
import torch

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.backend.registry import resolve
from tests.backend.scenes import picked, random_scene

VIEW = View(torch.eye(4), torch.tensor([[20.0, 0, 16], [0, 20, 12], [0, 0, 1]]), 32, 24)


def splats(opacities: list[float], depths: list[float], side: list[float]) -> Splats:
    n = len(opacities)
    means = torch.stack([torch.tensor(side), torch.zeros(n), torch.tensor(depths)], dim=-1)
    quats, scales = torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1), torch.full((n, 3), 0.1)
    return Splats(means, quats, scales, torch.tensor(opacities), colors=torch.rand(n, 3))


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


def test_columns_are_drawn_by_what_contributes_to_them(rasterizer):
    """What contributes nothing may have ended a pixel unseen: before it, blending has left at most
    TRANSMITTANCE_MIN / (1 - ALPHA_MAX), and so much at most shows of what is behind."""
    crowd, columns = random_scene(0, count=300, opacity=(0.9, 1.0)), 14
    whole = rasterizer(crowd.splats, crowd.view, RenderSettings()).rgb[:, :columns]
    weights = accumulated_weights(rasterizer, crowd.splats, crowd.view, RenderSettings(), columns)
    assert 0.1 < (weights > 0).float().mean() < 0.9
    fewer = picked(crowd, torch.nonzero(weights > 0)[:, 0]).splats
    off = (rasterizer(fewer, crowd.view, RenderSettings()).rgb[:, :columns] - whole).abs()
    assert off.max() <= TRANSMITTANCE_MIN / (1 - ALPHA_MAX)
    assert off.mean() < TRANSMITTANCE_MIN
