"""nerfstudio's own Splatfacto on a machine without a GPU: gsplat's part is drawn by our backend."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.models import splatfacto

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.datamanager import DeSplatDataManagerConfig
from desplat_ns.nerfstudio_quirks import splatfacto_modules_without_downloads
from lab.gpu.stand_in import rasterization
from lab.synthetic import Scene
from tests.helpers.registered import set_up


def splatfacto_trainer(scene: Scene, output: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """`ns-train splatfacto` as it is registered, set up on a generated scene.

    Its data manager is ours, as upstream's asks for CUDA; both take photos and cameras alike.
    """
    assert scene.folder is not None
    monkeypatch.setattr(torch.Tensor, "cuda", lambda tensor, *_, **__: tensor)
    monkeypatch.setattr(splatfacto, "rasterization", rasterization)
    config: Any = copy.deepcopy(all_methods["splatfacto"])
    parser = RobustNerfDataParserConfig(data=scene.folder)
    config.pipeline.datamanager = DeSplatDataManagerConfig(dataparser=parser)
    config.machine.device_type, config.vis = "cpu", "tensorboard"
    config.output_dir, config.experiment_name, config.timestamp = output, "eight", "run"
    with splatfacto_modules_without_downloads():
        return set_up(config)
