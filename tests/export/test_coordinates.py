"""Gaussians in other coordinates look the same to a camera that moved along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import CaptureError
from desplat_ns.export.coordinates import (
    Similarity,
    moved,
    similarity_to,
    turned_harmonics,
)
from desplat_ns.export.formats import FORMATS, Y_DOWN, Y_UP
from tests.helpers.clouds import cloud, drawn, view

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


def test_a_scene_seen_in_a_mirror_is_the_mirrored_picture():
    scene, mirror = cloud(3), np.diag([-1.0, 1.0, 1.0])
    there = moved(scene, Similarity(mirror, 1.0, np.zeros(3)))
    assert np.abs(drawn(there, view()) - drawn(scene, view())[:, ::-1]).max() < SEEN


def test_harmonics_of_degree_one_turn_as_the_axes_do():
    """Y_1 = C1 (-y, z, -x): the harmonic along z, turned so that z becomes x, is minus the last."""
    z_to_x = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    assert np.allclose(z_to_x @ [0, 0, 1], [1, 0, 0])
    along_z = np.zeros((1, 4, 3))
    along_z[0, :, 0] = (0.5, 0, 1, 0)
    turned = turned_harmonics(along_z, z_to_x)
    assert np.allclose(turned[0, :, 0], (0.5, 0, 0, -1), atol=1e-12)


def test_quaternions_of_turns_by_hand():
    """Of a Gaussian that was not turned before; q and -q are the same turn."""
    half = np.sqrt(0.5)
    about_z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    straight = replace(cloud(count=1), quats=np.array([[1.0, 0, 0, 0]], np.float32))
    for turn, quat in (
        (np.eye(3), (1, 0, 0, 0)),
        (about_z, (half, 0, 0, half)),
        (np.diag([1.0, -1, -1]), (0, 1, 0, 0)),
    ):
        turned = moved(straight, Similarity(turn, 1.0, np.zeros(3))).quats[0]
        assert abs(turned @ np.array(quat)) == pytest.approx(1, abs=1e-6)


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


@pytest.mark.parametrize(("suffix", "up"), [(".glb", 1), (".spz", 1), (".ply", -1)])
def test_up_is_up_and_the_captures_scale_is_kept(suffix: str, up: int):
    """nerfstudio's z, in a tenth of the capture's scale, becomes y."""
    transform = np.eye(4)[:3]
    by = similarity_to("upright", transform, 0.1, FORMATS[suffix].upright_axes)
    raised = replace(cloud(count=1), means=np.array([[0.0, 0.0, 2.0]]))
    assert np.allclose(moved(raised, by).means, [[0, 20 * up, 0]])
    assert np.linalg.det(by.turn) == pytest.approx(1.0), "nothing is mirrored"


def test_training_coordinates_stay_as_they_are():
    by = similarity_to("training", np.eye(4)[:3] * 3.0, 0.1, Y_DOWN)
    scene = cloud()
    assert np.array_equal(moved(scene, by).means, scene.means)


def test_a_transform_that_stretches_is_refused():
    with pytest.raises(CaptureError, match=r"applied_transform.*--frame training"):
        similarity_to("capture", np.diag([1.0, 2.0, 1.0, 1.0])[:3], 1.0, Y_UP)
