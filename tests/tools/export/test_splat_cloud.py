"""What a file holds of a model is what the model shows, also in other coordinates."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.backend.protocol import Splats
from desplat_ns.cameras.views import view_of
from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.export.formats import UPRIGHT, Y_UP
from desplat_ns.tools.export.splat_cloud import Similarity, baked, moved, similarity_to
from tests.helpers import small_model
from tests.helpers.small_model import held_out, model_with
from tests.helpers.splat_files import cloud, drawn, view

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
        small_model.moved(model)
    model.eval()
    model.step = 100_000  # all degrees are evaluated
    with torch.no_grad():
        model.gauss_params["features_rest"].data.normal_(std=0.2)
        shown = model.get_outputs_for_camera(held_out())["rgb"].numpy()
    cloud = baked(model.shown_splats(), antialiased=False)
    picture = drawn(cloud, view_of(held_out())).clip(0, 1)
    assert np.abs(picture - shown).max() < COLORS
    assert shown.max() > 0.2, "something is seen"


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


def test_an_empty_scene_is_refused():
    with pytest.raises(ConfigError, match="nothing"):
        baked(splats(opacities=torch.zeros(6)), antialiased=False)


SEEN = 1e-4
"""Of a colour. Quaternions, scales and coefficients come as float32, 6e-8 of their size; colours
sum some tens of them, and an edge of a Gaussian is a tenth of a pixel wide at least."""


def rotation(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def along(by: Similarity) -> np.ndarray:
    """The pose [4, 4] of the camera at the origin after it was moved as the scene was.

    Distances in its own axes grow by the scale: the picture is the same.
    """
    viewmat = np.eye(4)
    viewmat[:3, :3] = by.turn.T
    viewmat[:3, 3] = -by.turn.T @ by.shift
    return viewmat


@pytest.mark.slow
@given(st.integers(0, 10_000), st.floats(0.01, 100.0))
def test_a_camera_that_moves_along_sees_the_same_picture(seed: int, scale: float):
    scene = cloud(seed % 7)
    shift = np.random.default_rng(seed).normal(size=3)
    by = Similarity(rotation(seed), scale, shift)
    there = moved(scene, by)
    assert np.abs(drawn(there, view(along(by))) - drawn(scene, view())).max() < SEEN


def test_a_captures_own_coordinates_come_back():
    """nerfstudio trains on scale (turn p + shift)."""
    turn, shift, scale = rotation(5), np.array([3.0, -2.0, 0.5]), 0.31
    points = np.random.default_rng(0).normal(size=(9, 3)) * 20
    trained = scale * (points @ turn.T + shift)
    transform = np.concatenate([turn, shift[:, None]], axis=1)
    back = similarity_to("capture", transform, scale, Y_UP)
    scene = replace(cloud(count=9), means=trained)
    assert np.allclose(moved(scene, back).means, points)
    assert np.allclose(moved(scene, back).scales, scene.scales / 0.31, rtol=1e-6)


@pytest.mark.parametrize(("suffix", "up"), [(".spz", 1), (".ply", -1)])
def test_up_is_up_and_the_captures_scale_is_kept(suffix: str, up: int):
    """nerfstudio's z, in a tenth of the capture's scale, becomes y."""
    transform = np.eye(4)[:3]
    by = similarity_to("upright", transform, 0.1, UPRIGHT[suffix])
    raised = replace(cloud(count=1), means=np.array([[0.0, 0.0, 2.0]]))
    assert np.allclose(moved(raised, by).means, [[0, 20 * up, 0]])
    assert np.linalg.det(by.turn) == pytest.approx(1.0), "nothing is mirrored"
