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


@pytest.mark.slow
@pytest.mark.parametrize("auto", [True, False])
def test_photos_that_do_not_go_with_the_points_train_only_where_that_is_accepted(
    scene, tmp_path, auto: bool
):
    turned = Path(shutil.copytree(scene.folder, tmp_path / "turned"))
    for path in (turned / "images").iterdir():
        write_image(path, np.ascontiguousarray(read_image(path)[::-1, ::-1]))
    config = auto_run(scene, tmp_path / "runs", auto=auto)
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
