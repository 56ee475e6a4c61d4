from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from lab.synthetic import DaylightSpec, SceneSpec, apply_light, make_scene, write_scene
from lab.synthetic.cameras import arc
from lab.synthetic.render import draw, sky, to_pixels, to_uint8
from lab.synthetic.yard import furniture, walls_and_ground

LIT = replace(
    SceneSpec.tiny(), supersample=1, wall_height=2.6, seed=2, daylight=DaylightSpec(), num_extras=3
)


@pytest.fixture(scope="module")
def lit():
    return make_scene(LIT)


@pytest.fixture(scope="module")
def off():
    return make_scene(replace(LIT, daylight=None))


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """What light.json says."""
    folder = tmp_path_factory.mktemp("lit")
    write_scene(LIT, folder)
    return json.loads((folder / "light.json").read_text())


def test_without_daylight_the_yard_is_drawn_as_it_always_was():
    spec = SceneSpec.tiny()
    scene = make_scene(spec)
    half = np.radians(45.0)
    cameras = arc(np.linspace(-half, half, 6), (48, 32), np.random.default_rng([0, 0]))
    world = walls_and_ground(6.0) + furniture()
    for frame, camera in zip(scene.clean, cameras, strict=True):
        np.testing.assert_array_equal(frame.camera.K, camera.K)
        np.testing.assert_array_equal(frame.camera.viewmat, camera.viewmat)
        drawn = draw(world, camera, 2, sky(camera, 2), furniture())
        np.testing.assert_array_equal(frame.image, to_uint8(to_pixels(drawn.rgb, 2)))
    # Occluders and points: values of the first release. Another processor may round a pixel in a
    # hundred to the next level, 0.01 in the mean; another order of random numbers changes far more.
    means = [frame.image.mean() for frame in scene.clutter]
    first = [133.5171, 118.0766, 119.9718, 134.2574, 103.7797, 104.6864]
    np.testing.assert_allclose(means, first, atol=0.01)
    assert scene.points.xyz.shape == (3, 288)
    np.testing.assert_allclose(
        scene.points.xyz.mean(axis=1), [-0.0688054, 1.2484218, 1.1486703], atol=1e-5
    )
    assert scene.unlit == []
    assert {frame.daylight for frame in scene.clutter + scene.extra} == {None}


def test_daylight_changes_colours_only(lit, off):
    for frame, other in zip(lit.clutter + lit.extra, off.clutter + off.extra, strict=True):
        np.testing.assert_array_equal(frame.camera.viewmat, other.camera.viewmat)
        np.testing.assert_array_equal(frame.depth, other.depth)
        np.testing.assert_array_equal(frame.coverage, other.coverage)
        assert (frame.image != other.image).any(axis=2).mean() > 0.8
    np.testing.assert_array_equal(lit.points.xyz, off.points.xyz)
    for frame, other in zip(lit.unlit, off.extra, strict=True):
        np.testing.assert_array_equal(frame.image, other.image)


def test_the_saved_light_taken_back_gives_the_picture_without_it(lit, off, known):
    for frame, other in zip(lit.clutter + lit.extra, off.clutter + off.extra, strict=True):
        light = known[frame.name]["light"]
        factor, gamma = light["gain"] * np.array(light["tint"]), light["gamma"]
        photo, canonical = frame.image.astype(float), other.image.astype(float)
        solid = np.isfinite(frame.depth) | (frame.coverage > 0)
        usable = solid[..., None] & (photo > 20) & (photo < 255) & (canonical < 255)
        assert usable.mean() > 0.3
        # Both pictures are rounded by up to half a level.
        lowest, highest = (
            255 * (np.maximum(photo + half, 0) / 255 / factor) ** (1 / gamma) + half
            for half in (-0.501, 0.501)
        )
        assert ((lowest <= canonical) & (canonical <= highest))[usable].all()
        assert (highest - lowest)[usable].mean() < 4


def test_twins_have_the_same_light_and_different_photos_different_ones(lit, known):
    for clean, clutter in zip(lit.clean, lit.clutter, strict=True):
        assert clean.daylight == clutter.daylight
        untouched = clutter.coverage == 0
        np.testing.assert_array_equal(clean.image[untouched], clutter.image[untouched])
    own = {frame.daylight.light for frame in lit.clutter + lit.extra}
    assert len(own) == 9
    assert {frame.daylight.kind for frame in lit.extra} == {"noon", "overcast", "dusk"}
    assert set(known) == {f.name for f in lit.clean + lit.clutter + lit.extra}
    for frame in lit.clutter + lit.extra:
        assert known[frame.name]["light"]["gain"] == frame.daylight.light.gain
        assert known[frame.name]["sky"]["azimuth"] == frame.daylight.sky.azimuth


def test_where_nothing_stands_a_photo_shows_its_own_sky(lit):
    for frame in lit.clutter + lit.extra:
        is_sky = np.isinf(frame.depth) & (frame.coverage == 0)
        assert 0.02 < is_sky.mean() < 0.5
        colors = frame.daylight.sky.toward(frame.camera.rays(1)).transpose(1, 2, 0)
        expected = to_uint8(apply_light(colors, frame.daylight.light))
        np.testing.assert_array_equal(frame.image[is_sky], expected[is_sky])


@pytest.mark.parametrize("seed", [0, 1])
def test_the_sky_fills_a_fair_part_of_most_tourists_photos(seed):
    spec = replace(
        SceneSpec.tourism(seed), width=40, height=30, other_sizes=((30, 40), (36, 27)), num_points=9
    )
    shares = [np.isinf(frame.depth).mean() for frame in make_scene(spec).clean]
    assert np.mean([0.1 <= share <= 0.3 for share in shares]) > 0.6
    assert min(shares) > 0.05


def test_points_have_the_mean_colour_of_the_photos_that_see_them(lit):
    point = int(np.argmax(lit.points.is_seen.sum(axis=0)))
    colors = [
        frame.image[lit.points.rows[view, point], lit.points.columns[view, point]]
        for view, frame in enumerate(lit.clean + lit.extra)
        if lit.points.is_seen[view, point]
    ]
    assert len(colors) >= 3
    np.testing.assert_array_equal(lit.points.rgb[:, point], np.round(np.mean(colors, axis=0)))


def test_a_sky_behind_high_walls_is_an_error_that_says_what_to_lower():
    with pytest.raises(ConfigError, match=r"wall_height is 6\.0"):
        make_scene(replace(LIT, wall_height=6.0))
    walled = make_scene(replace(LIT, wall_height=6.0, daylight=DaylightSpec(sky=False)))
    assert walled.extra[0].daylight is not None
