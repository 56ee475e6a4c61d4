"""`effects.auto`: a run looks at its capture first, and everything after knows what it decided."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from desplat_ns.errors import ConfigError
from desplat_ns.runs.files import SURVEY
from desplat_ns.settings.effects import Effects, EffectsConfig
from lab.synthetic import Scene, write_scene
from tests.helpers.registered import EIGHT_VIEWS, registered_desplat, set_up


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(EIGHT_VIEWS, tmp_path_factory.mktemp("auto"))


def auto_run(scene: Scene, output: Path, **effects: Any) -> Any:
    config = registered_desplat(scene, output, max_num_iterations=2)
    for name, value in effects.items():
        setattr(config.pipeline.model.effects, name, value)
    return config


def saved_effects(config: Any) -> Effects:
    written = yaml.load(
        (config.get_base_dir() / "config.yml").read_text(), Loader=yaml.UnsafeLoader
    )
    assert not written.pipeline.model.effects.auto
    return written.pipeline.model.effects.settled()


@pytest.mark.slow
def test_the_survey_decides_and_the_run_is_saved_with_what_it_decided(scene, tmp_path):
    config = auto_run(scene, tmp_path)
    trainer = set_up(config)
    record = json.loads((config.get_base_dir() / SURVEY).read_text())
    decided = {name: record[name]["decision"] for name in ("appearance", "background")}
    assert trainer.pipeline.model.effects == Effects(True, **decided) == saved_effects(config)
    assert trainer.pipeline.model.effects.appearance == "off"


def test_what_is_given_stays(scene, tmp_path):
    config = auto_run(scene, tmp_path, appearance="camera", distractors=False)
    model = set_up(config).pipeline.model
    assert (model.effects.appearance, model.effects.distractors) == ("camera", False)
    assert saved_effects(config) == model.effects


def test_nothing_is_surveyed_where_all_is_given(scene, tmp_path):
    config = auto_run(scene, tmp_path, appearance="off", background="off")
    assert set_up(config).pipeline.model.effects == Effects()
    assert not (config.get_base_dir() / SURVEY).exists()


@pytest.mark.slow
def test_a_resumed_run_keeps_the_effects_of_its_checkpoint(scene, tmp_path):
    first = auto_run(scene, tmp_path, appearance="camera", distractors=False)
    set_up(first).train()
    second = auto_run(scene, tmp_path)
    second.timestamp, second.max_num_iterations = "second", 4
    second.load_dir = first.get_checkpoint_dir()
    trainer = set_up(second)
    assert trainer.pipeline.model.effects.appearance == "camera"
    assert not trainer.pipeline.model.effects.distractors
    assert not (second.get_base_dir() / SURVEY).exists()
    assert saved_effects(second).appearance == "camera"


def test_without_a_survey_nothing_is_guessed():
    with pytest.raises(ConfigError, match="survey"):
        EffectsConfig(auto=True, appearance="off").settled()
    whole = EffectsConfig(auto=True, distractors=False, appearance="sh", background="off")
    assert whole.settled() == Effects(False, "sh", "off")
    assert EffectsConfig().settled() == Effects(True, "off", "off")
