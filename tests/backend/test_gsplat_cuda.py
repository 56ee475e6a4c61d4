"""The gsplat backend without a GPU: what it passes on to gsplat and what it makes of the answer.

What gsplat draws is compared in `test_contract.py`, where there is a GPU.
"""

import inspect
import math
from typing import Any

import gsplat.rendering
import pytest
import torch

from desplat_ns.backend import RenderSettings
from desplat_ns.backend.gsplat_cuda import GsplatRasterizer
from tests.backend.reference import sh_colors
from tests.backend.scenes import TestScene, random_scene

REAL_SIGNATURE = inspect.signature(gsplat.rendering.rasterization)


class FakeGsplat:
    """Stands in for gsplat's `rasterization` and keeps what it was given."""

    def __init__(self) -> None:
        self.arguments: dict[str, Any] = {}

    def __call__(self, **arguments: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, Any]]:
        REAL_SIGNATURE.bind(**arguments)
        self.arguments = arguments
        height, width = arguments["height"], arguments["width"]
        channels = 4 if arguments["render_mode"] == "RGB+ED" else 3
        image = torch.arange(channels).expand(1, height, width, channels).float()
        radii = torch.tensor([[3, 0]], dtype=torch.int32)
        found = {"means2d": arguments["means"][None, :, :2], "radii": radii}
        return image, torch.ones(1, height, width, 1), found


def scene_of(count: int) -> TestScene:
    return random_scene(1, count=count, size=(7, 5), sh_degree=1).to(torch.float32)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeGsplat:
    fake = FakeGsplat()
    monkeypatch.setattr(gsplat.rendering, "rasterization", fake)
    return fake


def test_gsplat_gets_colours_that_are_evaluated_and_can_leave_black(fake):
    scene = scene_of(2)
    with torch.no_grad():
        scene.colors[1] = -9.0
    GsplatRasterizer()(scene.splats, scene.view, RenderSettings())
    colors = fake.arguments["colors"]
    wanted = sh_colors(scene.means, scene.colors, scene.view.center, 1)
    assert torch.allclose(colors, wanted, atol=1e-5) and not colors[1].any()
    (slope,) = torch.autograd.grad(-colors.sum(), scene.colors)
    assert (slope[1, 0] < 0).all()


def test_settings_are_gsplats_and_colour_and_depth_are_taken_apart(fake):
    scene, settings = scene_of(2), RenderSettings(antialiased=True, depth=True, absgrad=True)
    got = GsplatRasterizer()(scene.splats, scene.view, settings)
    assert fake.arguments["rasterize_mode"] == "antialiased" and fake.arguments["absgrad"]
    assert got.rgb[0, 0].tolist() == [0, 1, 2]
    assert got.depth is not None and got.depth[0, 0].tolist() == [3]
    assert got.radii.tolist() == [3, 0]
    without = GsplatRasterizer()(scene.splats, scene.view, RenderSettings())
    assert without.depth is None and without.rgb.shape == (5, 7, 3)


def test_unsound_gaussians_are_moved_behind_the_camera(fake):
    scene = scene_of(2)
    with torch.no_grad():
        scene.quats[0] = 0
        scene.opacities[1] = math.nan
    GsplatRasterizer()(scene.splats, scene.view, RenderSettings())
    moved = fake.arguments["means"]
    in_camera = moved @ scene.viewmat[:3, :3].T + scene.viewmat[:3, 3]
    assert torch.allclose(in_camera, torch.tensor([0.0, 0.0, -1.0]).expand(2, 3), atol=1e-6)


def test_nothing_to_draw_never_reaches_gsplat(fake):
    scene = scene_of(0)
    got = GsplatRasterizer()(scene.splats, scene.view, RenderSettings(depth=True))
    assert fake.arguments == {} and got.rgb.abs().max() == 0
    assert got.depth is not None and got.depth.shape == (5, 7, 1)
    got.rgb.sum().backward()
