"""What a tiny run's page shows is what the run holds; what cannot be is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.export.export import static_cloud
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import LoadedRun, load_run
from desplat_ns.scene.contents import AVERAGE
from desplat_ns.scene.gather import gather
from desplat_ns.scene.page import html_of
from desplat_ns.settings.effects import EffectsConfig
from tests.helpers.browser import find_browser
from tests.helpers.scene import psnr
from tests.helpers.scene_in_browser import bare_scene, settle, shown

if TYPE_CHECKING:
    from nerfstudio.engine.trainer import TrainerConfig

pytestmark = pytest.mark.slow

MOST = 5_000_000


@pytest.fixture(scope="module")
def run(trained: Path) -> LoadedRun:
    return load_run(find_run(trained))


def test_every_photo_has_its_camera_and_what_was_taken_out_of_it(run: LoadedRun):
    model: Any = run.pipeline.model
    contents = gather(run, 100, 100)
    manager = run.pipeline.datamanager
    training = [camera for camera in contents.cameras if not camera.held_out]
    assert [camera.name for camera in training] == list(manager.train_image_names)
    assert len(contents.cameras) - len(training) == len(manager.eval_dataset)
    assert contents.not_shown == "" and contents.light == ""
    for index, camera in enumerate(training):
        assert (camera.distractors is not None) == (len(model.layer.gaussians.views[index]) > 0)
        assert camera.photo.shape == (camera.view.height, camera.view.width, 3)
        assert camera.reach > camera.near > 0
    assert all(camera.distractors is None for camera in contents.cameras if camera.held_out)


def test_fewer_photos_are_told(run: LoadedRun):
    contents = gather(run, 2, 1)
    assert [camera.held_out for camera in contents.cameras] == [False, False, True]
    assert contents.not_shown.startswith("2 of 6 training photos and 1 of")


def test_gaussians_are_weighed_by_what_they_make_up_of_the_photos(run: LoadedRun):
    contents = gather(run, 1, 0)
    weights = contents.weigh(contents.cloud)
    assert weights.shape == (len(contents.cloud),) and (weights >= 0).all() and weights.max() > 1


def test_without_photos_there_is_no_camera_to_start_from(run: LoadedRun):
    with pytest.raises(CaptureError, match=r"no camera to start from.*--training-photos"):
        gather(run, 0, 0)


def test_a_crop_that_leaves_nothing_and_a_light_that_is_not_there_are_errors(run: LoadedRun):
    with pytest.raises(ConfigError, match="--crop 1e-06 leaves none of"):
        gather(run, 1, 0, crop=1e-6)
    with pytest.raises(ConfigError, match="same colours"):
        gather(run, 1, 0, light="a.jpg")


def test_other_lights_are_those_of_the_same_gaussians(
    tiny_run: Callable[[Path], TrainerConfig], tmp_path: Path
):
    """Also where a crop leaves some out."""
    from nerfstudio.scripts import train

    config: Any = tiny_run(tmp_path)
    config.pipeline.model.effects = EffectsConfig(distractors=False, appearance="affine")
    train.main(config)
    lit = load_run(find_run(config.get_base_dir() / "config.yml"))
    whole, cropped = (gather(lit, 2, 1, crop) for crop in (None, 1.0))
    assert whole.light == AVERAGE and len(cropped.cloud) < len(whole.cloud)
    for contents, crop in ((whole, None), (cropped, 1.0)):
        assert contents.other_lights
        for light in contents.other_lights:
            baked, _ = static_cloud(lit.pipeline, crop, light.name)
            assert np.abs(light.harmonics - baked.harmonics).max() < 1e-5
            assert np.abs(light.harmonics - contents.cloud.harmonics).max() > 1e-6


def test_in_a_browser_it_looks_as_the_model_renders_it(run: LoadedRun, tmp_path: Path):
    find_browser()
    model: Any = run.pipeline.model
    contents = gather(run, 100, 100)
    size = contents.cameras[0].view.width, contents.cameras[0].view.height
    decibels = []
    with bare_scene(tmp_path / "a.html", html_of(contents, MOST)[0], *size) as page:
        for index, camera in enumerate(contents.cameras):
            settle(page, f"scenePage.goTo({index})")
            with torch.no_grad():
                static = model.render_static(camera.view, model.embedding_of(None))
            background = np.asarray(contents.background, np.float32)
            ours = static.rgb.numpy() + (1 - static.alpha.numpy()) * background
            decibels.append(psnr(shown(page), ours.clip(0, 1)))
    assert min(decibels) > 30, decibels
