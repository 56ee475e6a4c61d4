"""nerfstudio's own Splatfacto on a machine without a GPU: gsplat's part is drawn by our backend."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.models import splatfacto

from desplat_ns.backend.numba_tiles import NumbaRasterizer
from desplat_ns.backend.protocol import RenderSettings, Splats, View
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.datamanager import DeSplatDataManagerConfig
from desplat_ns.gaussians.densification import strategy_info
from desplat_ns.nerfstudio_quirks import splatfacto_modules_without_downloads
from lab.synthetic import Scene
from tests.helpers.registered import set_up


def splatfacto_trainer(scene: Scene, output: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """`ns-train splatfacto` as it is registered, set up on a generated scene.

    Its data manager is ours, as upstream's asks for CUDA; both take photos and cameras alike.
    """
    assert scene.folder is not None
    monkeypatch.setattr(torch.Tensor, "cuda", lambda tensor, *_, **__: tensor)
    monkeypatch.setattr(splatfacto, "rasterization", _drawn)
    config: Any = copy.deepcopy(all_methods["splatfacto"])
    parser = RobustNerfDataParserConfig(data=scene.folder)
    config.pipeline.datamanager = DeSplatDataManagerConfig(dataparser=parser)
    config.machine.device_type, config.vis = "cpu", "tensorboard"
    config.output_dir, config.experiment_name, config.timestamp = output, "eight", "run"
    with splatfacto_modules_without_downloads():
        return set_up(config)


def _drawn(**given: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, Any]]:
    """What gsplat's `rasterization` gives."""
    names = ("means", "quats", "scales", "opacities", "colors", "sh_degree")
    splats = Splats(**{name: given[name] for name in names})
    view = View(given["viewmats"][0], given["Ks"][0], given["width"], given["height"])
    drawn = NumbaRasterizer()(splats, view, RenderSettings(absgrad=given["absgrad"]))
    return drawn.rgb[None], drawn.alpha[None], strategy_info(drawn, view)
