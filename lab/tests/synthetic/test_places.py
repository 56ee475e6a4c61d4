from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.synthetic import Scene, SceneSpec, make_scene
from lab.synthetic.facade import EAVES
from lab.synthetic.places import PLACES
from lab.synthetic.points import corners
from lab.synthetic.table import HALF


def small(spec: SceneSpec) -> Scene:
    return make_scene(replace(spec, num_extras=2, width=96, height=64, num_points=800))


@pytest.fixture(scope="module")
def facade() -> Scene:
    return small(SceneSpec.facade(8, seed=1))


@pytest.fixture(scope="module")
def table() -> Scene:
    return small(SceneSpec.table_top(12, seed=1))


@pytest.mark.parametrize("name", PLACES)
def test_every_camera_sees_past_what_stands_in_a_place(name: str):
    spec = replace(SceneSpec.tiny(2), place=name, arc_degrees=36.0)
    depths = [frame.depth for frame in make_scene(spec).clean]
    assert min(depth.min() for depth in depths) > 0.3


def test_a_corner_is_where_the_picture_changes_in_both_directions():
    image = np.zeros((20, 20, 3), np.uint8)
    image[10:, 10:] = 90
    strength = corners(image)
    assert strength[9:11, 9:11].min() > 5
    edges = np.r_[strength[10, 13:], strength[13:, 10], strength[:7].ravel()]
    assert edges.max() == pytest.approx(0, abs=1e-6)


def test_a_lawn_and_a_sky_have_hardly_a_point(facade: Scene):
    x, y, z = facade.points.xyz
    is_house = (np.abs(x) < 9) & (y > -2.5) & (y < 8)
    assert is_house.mean() > 0.7
    # What is nearer than the house lies on the lawn, but for the trees at the borders.
    lawn = np.mean([(f.depth < 17).mean() for f in facade.clean])
    assert lawn > 0.25
    assert ((z < 0.1) & (y < -2.5)).mean() < 0.3 * lawn
    assert np.mean([np.isinf(f.depth).mean() for f in facade.clean]) > 0.1
    assert z.max() > EAVES


def test_few_photos_share_the_trees_beside_the_lawn(facade: Scene):
    x, y, _ = facade.points.xyz
    views = facade.points.is_seen[: len(facade.clean)].sum(axis=0)
    is_tree = (np.abs(x) > 4) & (y < -7)
    assert is_tree.any()
    assert np.median(views[is_tree]) < 0.6 * np.median(views[~is_tree])


def test_the_room_behind_a_table_is_far_and_in_few_photos_and_points(table: Scene):
    away = np.hypot(*table.points.xyz[:2])
    views = table.points.is_seen[: len(table.clean)].sum(axis=0)
    is_behind = away > 0.4 * HALF
    assert 0 < is_behind.mean() < 0.2
    assert np.median(views[is_behind]) < 0.6 * np.median(views[~is_behind])
    assert np.mean([(f.depth > 9).mean() for f in table.clean]) > 0.25
