"""How far the cameras look, and what lies within a multiple of that."""

import numpy as np
import pytest
import torch

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.errors import ConfigError
from desplat_ns.export.surroundings import SIDE, Surroundings, surroundings_of
from tests.helpers.clouds import view


def rendering(camera: View, depth: float, alpha: float) -> Rendering:
    size = (camera.height, camera.width, 1)
    depths = torch.full(size, depth)
    depths[0] = 1e6  # a row of sky
    return Rendering(
        torch.zeros(camera.height, camera.width, 3),
        torch.full(size, alpha),
        depths,
        torch.zeros(1, 0, 2),
        torch.zeros(0, dtype=torch.int64),
    )


def test_a_cameras_reach_is_the_median_depth_of_what_it_shows():
    pose = np.eye(4)
    pose[:3, 3] = (1, 2, 3)
    surroundings = surroundings_of([view(), view(pose)], lambda camera: rendering(camera, 4.0, 0.9))
    assert np.allclose(surroundings.reaches, 4)
    assert np.allclose(surroundings.places, [(0, 0, 0), (-1, -2, -3)])


def test_the_views_that_are_looked_through_are_small_and_see_the_same():
    sizes = []

    def rasterize(camera: View) -> Rendering:
        sizes.append((camera.width, camera.height))
        assert camera.K[0, 0] / camera.width == pytest.approx(40 / 48, rel=0.02)
        return rendering(camera, 1.0, 1.0)

    large = View(view().viewmat, view().K * torch.tensor([[50.0], [50], [1]]), 2400, 2000)
    surroundings_of([large], rasterize)
    assert sizes == [(SIDE, 53)]


def test_what_is_near_to_any_camera_is_kept():
    around = Surroundings(np.array([[0.0, 0, 0], [10, 0, 0]]), np.array([1.0, 2.0]))
    points = np.array([[1.9, 0, 0], [2.1, 0, 0], [6.1, 0, 0], [14.1, 0, 0]])
    assert around.within(points, 2.0).tolist() == [True, False, True, False]
    assert around.within(points, 100.0).all()


def test_a_scene_of_which_nothing_is_solid_cannot_be_cropped():
    with pytest.raises(ConfigError, match="leave out --crop"):
        surroundings_of([view()], lambda camera: rendering(camera, 4.0, 0.1))
