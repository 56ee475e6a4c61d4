"""`effects.auto`: a run looks at its capture first, and everything after knows what it decided."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from desplat_ns.core.effects import Effects, EffectsConfig
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.run_files import SURVEY
from desplat_ns.data.images import read_image
from lab.pictures import write_image
from lab.synthetic import Scene
from tests.helpers.registered import registered_desplat, set_up


def auto_run(scene: Scene, output: Path, **effects: Any) -> Any:
    config = registered_desplat(scene, output, max_num_iterations=2)
    for name, value in effects.items():
        setattr(config.pipeline.model.effects, name, value)
    return config


def saved_effects(config: Any) -> Effects:
    text = (config.get_base_dir() / "config.yml").read_text()
    written = yaml.load(text, Loader=yaml.UnsafeLoader)
    assert not written.pipeline.model.effects.auto
    return written.pipeline.model.effects.settled()


@pytest.mark.slow
def test_the_survey_decides_and_the_run_is_saved_with_what_it_decided(eight_views, tmp_path):
    config = auto_run(eight_views, tmp_path)
    trainer = set_up(config)
    record = json.loads((config.get_base_dir() / SURVEY).read_text())
    decided = {name: record[name]["decision"] for name in ("appearance", "background")}
    assert trainer.pipeline.model.effects == Effects(True, **decided) == saved_effects(config)
    assert trainer.pipeline.model.effects.appearance == "off"


def test_nothing_is_surveyed_where_all_is_given(eight_views, tmp_path):
    config = auto_run(eight_views, tmp_path, appearance="off", background="off")
    assert set_up(config).pipeline.model.effects == Effects()
    assert not (config.get_base_dir() / SURVEY).exists()


@pytest.mark.slow
def test_what_is_given_stays_and_a_resumed_run_keeps_its_checkpoints_effects(eight_views, tmp_path):
    first = auto_run(eight_views, tmp_path, appearance="camera", distractors=False)
    second = auto_run(eight_views, tmp_path)
    second.timestamp, second.max_num_iterations = "second", 4
    second.load_dir = first.get_checkpoint_dir()
    for config in (first, second):
        trainer = set_up(config)
        effects = trainer.pipeline.model.effects
        assert (effects.appearance, effects.distractors) == ("camera", False)
        assert saved_effects(config) == effects
        assert (config.get_base_dir() / SURVEY).exists() == (config is first)
        trainer.train()


@pytest.mark.slow
@pytest.mark.parametrize("auto", [True, False])
def test_photos_that_do_not_go_with_the_points_train_only_where_that_is_accepted(
    eight_views, tmp_path, auto: bool
):
    turned = Path(shutil.copytree(eight_views.folder, tmp_path / "turned"))
    for path in (turned / "images").iterdir():
        write_image(path, np.ascontiguousarray(read_image(path)[::-1, ::-1]))
    config = auto_run(eight_views, tmp_path / "runs", auto=auto)
    config.pipeline.datamanager.dataparser.data = turned
    with pytest.raises(CaptureError, match="--accept-mismatch True"):
        set_up(config)
    assert not config.output_dir.exists()
    config.accept_mismatch = True
    set_up(config)


def test_without_a_survey_nothing_is_guessed():
    with pytest.raises(ConfigError, match="survey"):
        EffectsConfig(auto=True, appearance="off").settled()
    whole = EffectsConfig(auto=True, distractors=False, appearance="sh", background="off")
    assert whole.settled() == Effects(False, "sh", "off")
    assert EffectsConfig().settled() == Effects(True, "off", "off")
