"""What a file holds of a model is what the model shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from desplat_ns.backend.protocol import Splats
from desplat_ns.errors import ConfigError
from desplat_ns.export.baked import baked
from desplat_ns.rendering.views import view_of
from tests.helpers.clouds import drawn
from tests.helpers.relit_model import held_out, model_with, moved

COLORS = 1e-4
"""float32 beside float64: networks of some hundred sums, colours of some tens."""


def splats(**changes) -> Splats:
    made = Splats(
        means=torch.rand(6, 3),
        quats=torch.rand(6, 4) + 0.1,
        scales=torch.rand(6, 3) + 0.1,
        opacities=torch.rand(6) * 0.9 + 0.05,
        colors=torch.rand(6, 16, 3),
        sh_degree=3,
    )
    return replace(made, **changes)


@pytest.mark.slow
@pytest.mark.parametrize("appearance", ["off", "affine", "sh"])
def test_a_file_looks_like_the_static_scene_in_the_light_that_is_shown(appearance: str):
    model = model_with(appearance)
    if appearance != "off":
        moved(model)
    model.eval()
    model.step = 100_000  # all degrees are evaluated
    with torch.no_grad():
        model.gauss_params["features_rest"].data.normal_(std=0.2)
        shown = model.get_outputs_for_camera(held_out())["rgb"].numpy()
    cloud = baked(model.shown_splats(), antialiased=False)
    picture = drawn(cloud, view_of(held_out())).clip(0, 1)
    assert np.abs(picture - shown).max() < COLORS
    assert shown.max() > 0.2, "something is seen"


def test_the_light_of_one_photo_is_baked_when_it_is_shown():
    model = moved(model_with("affine")).eval()
    of_each = []
    for photo in (0, 1):
        with model.shown_in(model.image_effects.of(photo)):
            of_each.append(baked(model.shown_splats(), antialiased=False).harmonics)
    assert np.abs(of_each[0] - of_each[1]).max() > 0.01


def test_what_no_view_shows_is_left_out():
    scene = splats()
    scene.opacities[0] = 1 / 256
    scene.means[1] = float("nan")
    scene.colors[2] = float("inf")
    scene.scales[3] = 1e35
    cloud = baked(scene, antialiased=False)
    assert np.array_equal(cloud.means, scene.means[4:].double().numpy())


def test_only_harmonics_that_are_evaluated_and_that_readers_know_are_written():
    assert baked(splats(sh_degree=1), False).harmonics.shape == (6, 4, 3)
    assert baked(splats(colors=torch.rand(6, 25, 3), sh_degree=4), False).degree == 3


def test_colours_without_harmonics_are_written_as_zeroth_coefficients():
    colors = torch.rand(6, 3)
    cloud = baked(splats(colors=colors, sh_degree=None), antialiased=False)
    assert np.allclose(0.28209479 * cloud.harmonics[:, 0] + 0.5, colors, atol=1e-6)


def test_quaternions_are_of_length_1():
    assert np.allclose(np.linalg.norm(baked(splats(), False).quats, axis=1), 1)


def test_an_empty_scene_is_refused():
    with pytest.raises(ConfigError, match="nothing to export"):
        baked(splats(opacities=torch.zeros(6)), antialiased=False)
