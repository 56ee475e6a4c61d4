"""Splatfacto's modules without a network and without CUDA: the same parameters, no LPIPS inside."""

import os
import sys
from enum import Enum
from typing import Any

import pytest
import torch
import yaml
from nerfstudio.data.scene_box import SceneBox
from nerfstudio.models.splatfacto import SH2RGB, SplatfactoModel, SplatfactoModelConfig
from nerfstudio.utils import writer
from nerfstudio.utils.rich_utils import CONSOLE
from nerfstudio.viewer import control_panel

from desplat_ns import plugin
from desplat_ns.metrics import LazyLpips
from desplat_ns.plugin import (
    give_masks_a_colormap_in_the_viewer,
    splatfacto_modules_without_cuda,
    splatfacto_modules_without_torchmetrics,
    train_on_where_logs_cannot_be_written,
)

COLORS = torch.tensor([[0, 128, 255]] * 6, dtype=torch.uint8)


class _Model(SplatfactoModel):
    def populate_modules(self) -> None:
        with splatfacto_modules_without_torchmetrics(), splatfacto_modules_without_cuda(self):
            super().populate_modules()


def _model(seed_points: Any, **config: Any) -> _Model:
    box = SceneBox(torch.tensor([[-1.0] * 3, [1.0] * 3]))
    settings = SplatfactoModelConfig(_target=_Model, num_random=50, **config)
    return settings.setup(scene_box=box, num_train_data=2, seed_points=seed_points)


def _points() -> torch.Tensor:
    return torch.rand((6, 3), generator=torch.Generator().manual_seed(0))


@pytest.mark.slow
def test_a_model_has_its_points_and_their_colours_as_its_own_and_no_metric_network():
    points = _points()
    model = _model((points, COLORS))
    assert isinstance(model.lpips, LazyLpips) and model.lpips.reason is None
    assert model.psnr(torch.zeros(2), torch.full((2,), 0.1)).item() == pytest.approx(20.0, abs=1e-5)
    assert not [key for key in model.state_dict() if "lpips" in key]
    assert torch.allclose(SH2RGB(model.features_dc), COLORS / 255, atol=1e-6)
    assert not model.features_rest.any()
    assert model.seed_points is not None and torch.equal(model.seed_points[1], COLORS)
    model.means.data += 1.0
    assert torch.equal(points, _points()), "training moves the data parser's own points"


def test_black_and_white_points_without_harmonics_have_a_slope():
    ends = torch.tensor([[0, 0, 0], [255, 255, 255]] * 3, dtype=torch.uint8)
    model = _model((_points(), ends), sh_degree=0)
    assert (model.colors - ends / 255).abs().max() < 0.6 / 255
    assert (model.colors * (1 - model.colors)).min() > 1e-3


def test_masks_get_a_colormap_and_everything_else_keeps_its_own():
    panel: Any = control_panel
    kinds = [(3, torch.float32), (1, torch.float32), (5, torch.float32)]
    before = [panel._get_colormap_options(*kind) for kind in kinds]
    give_masks_a_colormap_in_the_viewer()
    give_masks_a_colormap_in_the_viewer()
    assert panel._get_colormap_options(1, torch.bool) == ["default"]
    assert [panel._get_colormap_options(*kind) for kind in kinds] == before


class _AsInPython3112(Enum):
    ONE = "first"

    def __reduce_ex__(self, protocol: Any) -> Any:
        return getattr, (self.__class__, self.name)


def test_enumerations_are_written_by_value_in_any_python():
    plugin.write_enumerations_by_value()
    text = yaml.dump([_AsInPython3112.ONE])
    assert "getattr" not in text
    assert yaml.load(text, Loader=yaml.UnsafeLoader) == [_AsInPython3112.ONE]


def test_a_run_goes_on_when_what_reads_its_output_ends(monkeypatch: pytest.MonkeyPatch):
    for owner, name in ((writer, "write_out_storage"), (CONSOLE, "on_broken_pipe")):
        monkeypatch.setattr(owner, name, getattr(owner, name))  # and as they were afterwards
    train_on_where_logs_cannot_be_written()
    reading, writing = os.pipe()
    monkeypatch.setattr(CONSOLE, "quiet", False)
    with open(writing, "w") as unread:
        monkeypatch.setattr(sys, "stdout", unread)
        os.close(reading)
        CONSOLE.print("nobody reads this")
        print("nor this", flush=True)
    assert CONSOLE.quiet, "it was noticed"
