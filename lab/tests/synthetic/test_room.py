from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from lab.synthetic import OccluderSpec, SceneSpec, make_scene
from lab.synthetic.lamps import LAMPS, mirrored
from lab.synthetic.points import BARE, BARE_INDOORS, sample_pixels
from lab.synthetic.primitives import Rect, Sphere
from lab.synthetic.render import reflection
from lab.synthetic.room import HALF, glossy_things, walls_and_floor
from lab.synthetic.textures import Glossy, Plain


def small_room(**occluders) -> SceneSpec:
    spec = SceneSpec.bare_room(6)
    return replace(
        spec,
        num_extras=2,
        width=48,
        height=36,
        num_points=200,
        occluders=replace(spec.occluders, **occluders),
    )


def test_walls_face_the_room_and_things_stand_inside():
    inside = np.array([0.0, 0.0, 1.0])
    for wall in walls_and_floor(5.0):
        assert isinstance(wall, Rect)
        center, _ = wall.bounds()
        normals, _ = wall.surface(center[:, None])
        assert normals[:, 0] @ (inside - center) > 0
    for thing in glossy_things():
        center, _ = thing.bounds()
        assert np.abs(center[:2]).max() < HALF
        assert center[2] > 0


def test_a_wall_has_one_colour():
    for wall in walls_and_floor(5.0)[1:]:
        uv = np.random.default_rng(0).random((2, 50), dtype=np.float32)
        assert np.ptp(wall.texture(uv), axis=1).max() == 0


def test_indoors_hardly_a_point_is_found_where_there_is_no_structure():
    image = np.full((40, 40, 3), 200, np.uint8)
    image[:, 20:] = 100
    shares = {}
    for bare in (BARE, BARE_INDOORS):
        _, columns = sample_pixels(image, 2000, np.random.default_rng(0), bare)
        shares[bare] = np.isin(columns, (19, 20)).mean()
    assert shares[BARE] < 0.7  # 2 columns of slope 50 among 38 of slope 2
    assert shares[BARE_INDOORS] > 0.95


def test_a_glossy_ball_mirrors_a_lamp_where_the_normal_lies_between_it_and_the_camera():
    ball = Sphere(np.zeros(3), 1.0, Glossy(Plain((0.0, 0.0, 0.0)), 0.5))
    lamp = np.array(LAMPS[0]) / np.linalg.norm(LAMPS[0])
    to_camera = np.array([1.0, 0.0, 0.0])
    middle = (lamp + to_camera) / np.linalg.norm(lamp + to_camera)
    light = reflection(ball, middle[:, None], -3 * to_camera[:, None])
    assert light[:, 0] == pytest.approx(0.5)  # the lamp alone is brighter than 1
    away = reflection(ball, -middle[:, None], to_camera[:, None])
    assert away.max() < 0.25


def test_what_is_mirrored_lies_in_the_unit_range():
    directions = np.random.default_rng(0).normal(size=(3, 1000))
    light = mirrored((directions / np.linalg.norm(directions, axis=0)).astype(np.float32))
    assert light.min() >= 0
    assert light.max() <= 1


def test_faint_occluders_are_pale():
    colours = {}
    for faint in (0.0, 1.0):
        scene = make_scene(small_room(faint=faint, lingering=0.0))
        pixels = np.concatenate([f.image[f.coverage == 1] for f in scene.clutter]).astype(float)
        colours[faint] = np.ptp(pixels, axis=1).mean()  # of a grey: 0
    assert colours[1.0] < 0.5 * colours[0.0]


def test_what_lingers_stands_at_its_place_in_the_next_view():
    moving = make_scene(small_room(lingering=0.0))
    lingering = make_scene(small_room(lingering=0.99))
    assert [f.coverage.tolist() for f in moving.clutter] != [
        f.coverage.tolist() for f in lingering.clutter
    ]
    assert np.array_equal(moving.clutter[0].image, lingering.clutter[0].image)


def test_shares_beyond_one_are_an_error():
    with pytest.raises(ConfigError, match=r"faint is 2\.0"):
        OccluderSpec(faint=2.0)
    with pytest.raises(ConfigError, match=r"lingering 1\.0"):
        OccluderSpec(lingering=1.0)
