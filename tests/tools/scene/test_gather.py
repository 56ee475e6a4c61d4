"""What a tiny run's page shows is what the run holds; what cannot be is told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from desplat_ns.cameras.views import view_of
from desplat_ns.core.console import text_of
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.run_files import find_run
from desplat_ns.tools.export.splat_cloud import baked
from desplat_ns.tools.loading import LoadedRun, load_run
from desplat_ns.tools.scene.gather import AVERAGE, light_of, other_lights, scene_of
from tests.helpers.small_model import held_out, model_with, moved

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(trained: Path) -> LoadedRun:
    return load_run(find_run(trained))


def test_every_photo_has_its_camera_and_what_was_taken_out_of_it(run: LoadedRun):
    model: Any = run.pipeline.model
    contents = scene_of(run, 100, 100)
    manager = run.pipeline.datamanager
    training = [camera for camera in contents.cameras if not camera.held_out]
    assert [camera.name for camera in training] == list(manager.train_image_names)
    assert len(contents.cameras) - len(training) == len(manager.eval_dataset)
    assert contents.not_shown == "" and contents.light == ""
    for index, camera in enumerate(training):
        assert (camera.distractors is not None) == (len(model.distractors.views[index]) > 0)
        assert camera.photo.pixels.shape == (camera.view.height, camera.view.width, 3)
        assert camera.reach > camera.near > 0
    assert all(camera.distractors is None for camera in contents.cameras if camera.held_out)


def test_fewer_photos_are_told_and_gaussians_weighed_by_what_they_make_up_of_the_photos(
    run: LoadedRun,
):
    contents = scene_of(run, 2, 1)
    assert [camera.held_out for camera in contents.cameras] == [False, False, True]
    assert contents.not_shown.startswith("2 of 6 training photos and 1 of")
    weights = contents.weigh(contents.cloud)
    assert weights.shape == (len(contents.cloud),) and (weights >= 0).all() and weights.max() > 1


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"most_training": 0}, CaptureError, "--training-photos"),
        ({"crop": 1e-6}, ConfigError, "--crop"),
        ({"light": "a.jpg"}, ConfigError, "--light"),
    ],
)
def test_what_cannot_be_shown_is_an_error_that_names_the_option(
    run: LoadedRun, options: dict[str, Any], error: type[Exception], named: str
):
    with pytest.raises(error, match=named):
        scene_of(run, **{"most_training": 1, "most_held_out": 0, **options})


@pytest.mark.parametrize("appearance", ["affine", "sh"])
def test_each_light_has_the_colours_that_are_baked_for_its_photo(appearance: str):
    model = moved(model_with(appearance)).eval()
    model.names = [f"photo {i}.jpg" for i in range(model.num_train_data)]
    model.names[0] += "\udcfc"  # a byte that is no text
    rows = torch.arange(model.num_points) % 3 != 0
    lights = other_lights(model, rows, view_of(held_out()))
    assert len(lights) == len({light.name for light in lights}) == 3
    for light in lights:
        photo = [text_of(name) for name in model.names].index(light.name)
        with model.shown_light.fixed(model.image_effects.of(photo)):
            whole = baked(model.shown_splats().rows(rows), antialiased=False)
        assert np.allclose(light.harmonics, whole.harmonics, atol=1e-5)


@pytest.mark.parametrize(
    ("appearance", "asked", "expected"),
    [
        ("off", None, ""),
        ("camera", None, AVERAGE),
        ("affine", None, AVERAGE),
        ("sh", "gr\udcfcn.jpg", "gr\\xfcn.jpg"),
    ],
)
def test_a_page_tells_whose_light_it_shows_where_photos_differ(
    appearance: str, asked: str | None, expected: str
):
    model = model_with(appearance).eval()
    assert light_of(model, asked) == expected
    if appearance == "off":
        rows = torch.ones(model.num_points, dtype=torch.bool)
        assert other_lights(model, rows, view_of(held_out())) == []
