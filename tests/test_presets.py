"""Presets: as long as the photos ask for; config.yml says how long that is."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.core.optimizers import set_position
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from lab.synthetic import Scene
from tests.helpers.registered import set_up


def preset(name: str, scene: Scene, output: Path, **changes: Any) -> Any:
    assert scene.folder is not None
    config: Any = copy.deepcopy(all_methods[name])
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(data=scene.folder)
    config.pipeline.model.effects.auto = False
    config.output_dir, config.experiment_name, config.timestamp = output, "tiny", "run"
    config.vis = "tensorboard"
    for field, value in changes.items():
        setattr(config, field, value)
    config.save_config()  # as ns-train does
    return config


@pytest.mark.parametrize("name", ["desplat-quick", "desplat"])
def test_a_preset_is_as_long_as_the_photos_ask_for(name, tiny_scene, tmp_path):
    config = preset(name, tiny_scene, tmp_path)
    visits, full_rate_visits = config.visits, config.full_rate_visits
    full_rate = config.optimizers["scales"]["optimizer"].lr
    trainer = set_up(config)
    photos = len(trainer.pipeline.datamanager.train_image_names)
    assert photos < 40
    steps = round(visits * 40)
    assert trainer.config.max_num_iterations == steps
    assert trainer.config.pipeline.model.schedule_scale == steps / config.nominal_num_iterations
    saved = yaml.load((config.get_base_dir() / "config.yml").read_text(), Loader=yaml.UnsafeLoader)
    assert saved.max_num_iterations == steps
    assert saved.pipeline.model.schedule_scale == steps / config.nominal_num_iterations
    for scheduler in trainer.optimizers.schedulers.values():
        set_position(scheduler, 300)  # few photos have higher rates before
    rate = trainer.optimizers.optimizers["scales"].param_groups[0]["lr"]
    assert rate == pytest.approx(full_rate * full_rate_visits / visits)  # as with 40 photos
