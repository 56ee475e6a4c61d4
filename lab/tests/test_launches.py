"""What the search for regions gives a GPU to do, counted without one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.fx.experimental.symbolic_shapes import ShapeEnv

import desplat_ns.separation.regions as regions_of_photos
from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.memory import GaussianMemory
from desplat_ns.separation.grid import _shares
from desplat_ns.separation.layer import DistractorLayer, TrainStep
from desplat_ns.separation.witness import Witnesses
from lab.synchronisations import Launches, Synchronisations
from tests.helpers.well_known_scene import cameras

WIDTH, HEIGHT, N = 480, 270, 50

MOST = 200
"""Operations of a search. A GPU takes some 5 microseconds to be given one, so that they are a
millisecond; the rest of a step is drawn and scored in a few fused ones."""


@pytest.fixture
def fake_gpu() -> Iterator[None]:
    with FakeTensorMode(shape_env=ShapeEnv()):
        yield
    _shares.cache_clear()  # what is made of fake tensors is of use among them only


def search(device: str) -> Callable[[], None]:
    """Of a step after the warm-up, ready."""

    def numbers(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, device=device)

    layer = DistractorLayer.__new__(DistractorLayer)
    layer.background, layer.witnesses = "off", Witnesses(None, cameras())
    layer.config, layer.num_views = DistractorConfig(start="residual", static_alone=True), 8
    radii = torch.ones(N, dtype=torch.int32, device=device)
    image, alpha = numbers(HEIGHT, WIDTH, 3), numbers(HEIGHT, WIDTH, 1)
    static = Rendering(image, alpha, None, 200 * numbers(1, N, 2), radii)
    view = View(numbers(4, 4), numbers(3, 3), WIDTH, HEIGHT)
    step = TrainStep(20, 0, view, static)
    step.photo, step.static_rgb = numbers(HEIGHT, WIDTH, 3), image
    opacities = numbers(N, 1)

    def look() -> None:
        layer.update_regions(step, opacities, GaussianMemory({}), None)
        assert step.regions is not None and step.residual_stats is not None

    return look


@pytest.mark.usefixtures("fake_gpu")
def test_launches_are_what_makes_or_fills_a_tensor_on_the_device():
    with Launches() as counted:
        values = torch.rand(4, 6, device="cuda")
        values[1:].T.reshape(2, 9)  # a view, and a copy
        values.add_(1.0)
        torch.empty(3, device="cuda")
        torch.rand(3)
    assert counted.counts == {"rand": 1, "clone": 1, "add_": 1}


@pytest.mark.usefixtures("fake_gpu")
def test_a_search_is_few_launches(monkeypatch: pytest.MonkeyPatch):
    """All but which cells are connected, which is OpenCV's to say, on the CPU."""
    monkeypatch.setattr(regions_of_photos, "outlier_regions", lambda weak, strong: weak & strong)
    look = search("cuda")
    look()
    with Launches() as counted:
        look()
    assert 20 < counted.total <= MOST, counted.counts.most_common()


def test_a_search_waits_for_the_gpu_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(regions_of_photos, "MAX_PEAK", -1.0)  # on a CPU it ends where nothing is
    look = search("cpu")
    with Synchronisations() as counted:
        look()
    assert counted.total == 1, counted.report()
