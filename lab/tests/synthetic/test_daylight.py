from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.errors import ConfigError
from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.daylight import (
    CLOUD,
    KINDS,
    TINT_SPREAD,
    Daylight,
    DaylightSpec,
    develop,
    draw_daylights,
)
from lab.synthetic.light import Light, apply_light
from lab.synthetic.primitives import Sphere
from lab.synthetic.render import DIRECT, SUN, draw, sky, to_pixels, to_uint8
from lab.synthetic.sky import Sky
from lab.synthetic.textures import Plain

K = np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]])
CAMERA = PinholeCamera(K, look_at(np.array([0.0, -3, 0]), np.array([0.0, 0, 1])), 48, 32)
BALL = Sphere(np.zeros(3), 0.5, Plain((1.0, 0.5, 0.25)))
SKY = Sky((0.5, 0.5, 0.5), (0.2, 0.3, 0.8), (0.1, 0.0, 0.0))


def daylights(spec: DaylightSpec, count: int = 30, seed: int = 0) -> list[Daylight]:
    return draw_daylights(spec, count, np.random.default_rng(seed))


def test_every_kind_is_equally_frequent_and_lies_in_its_range():
    drawn = daylights(DaylightSpec())
    assert sorted({d.kind for d in drawn}) == sorted(KINDS)
    for name, kind in KINDS.items():
        mine = [d for d in drawn if d.kind == name]
        assert len(mine) == 10
        for daylight in mine:
            assert kind.gain[0] <= daylight.light.gain <= kind.gain[1]
            assert kind.gamma[0] <= daylight.light.gamma <= kind.gamma[1]
            ratio = np.array(daylight.light.tint) / kind.tint
            assert (np.abs(ratio - 1) <= TINT_SPREAD + 1e-12).all()
    assert len({d.light for d in drawn}) == len({d.sky for d in drawn}) == 30


def test_one_seed_gives_one_daylight_and_another_seed_another():
    spec = DaylightSpec()
    assert daylights(spec) == daylights(spec)
    assert daylights(spec) != daylights(spec, seed=1)


def test_a_kind_named_twice_is_twice_as_frequent():
    drawn = daylights(DaylightSpec(kinds=("dusk", "dusk", "noon")))
    assert sum(d.kind == "dusk" for d in drawn) == 20


def test_strength_scales_the_light_and_leaves_the_sky():
    full, none = daylights(DaylightSpec()), daylights(DaylightSpec(strength=0.0))
    assert {d.light for d in none} == {Light()}
    assert [d.sky for d in none] == [d.sky for d in full]
    some = daylights(DaylightSpec(strength=0.5, sky=False))
    assert [d.light for d in some] == [d.light.scaled(0.5) for d in full]
    assert {d.sky for d in some} == {None}


@pytest.mark.parametrize("kinds", [(), ("noon", "night")])
def test_unknown_kinds_of_daylight_are_an_error_that_lists_the_known_ones(kinds):
    with pytest.raises(ConfigError, match="overcast"):
        DaylightSpec(kinds=kinds)


@pytest.mark.parametrize("strength", [-0.1, 1.1, float("nan")])
def test_a_strength_out_of_range_is_an_error(strength):
    with pytest.raises(ConfigError, match="strength"):
        DaylightSpec(strength=strength)


def test_without_daylight_a_photo_is_the_mean_of_its_samples():
    samples = draw([BALL], CAMERA, 2, sky(CAMERA, 2))
    expected = to_uint8(to_pixels(samples.rgb, 2))
    np.testing.assert_array_equal(develop(samples, CAMERA, 2, None), expected)


def test_the_sky_fills_what_no_ray_hits_and_the_light_falls_on_everything():
    samples = draw([BALL], CAMERA, 1, sky(CAMERA, 1))
    hit = np.isfinite(samples.depth)
    assert 0.02 < hit.mean() < 0.9
    daylight = Daylight("dusk", Light(0.6, (1.2, 1.0, 0.8), 1.3), SKY)
    photo = develop(samples, CAMERA, 1, daylight)
    canonical = np.where(hit, samples.rgb, SKY.toward(CAMERA.rays(1))).transpose(1, 2, 0)
    np.testing.assert_array_equal(photo, to_uint8(apply_light(canonical, daylight.light)))
    plain = develop(samples, CAMERA, 1, replace(daylight, sky=None))
    lit = to_uint8(apply_light(samples.rgb.transpose(1, 2, 0), daylight.light))
    np.testing.assert_array_equal(plain, lit)
    np.testing.assert_array_equal(plain[hit], photo[hit])
    assert (plain[~hit] != photo[~hit]).any(axis=1).mean() > 0.9


def test_a_photo_can_be_developed_twice():
    samples = draw([BALL], CAMERA, 1, sky(CAMERA, 1))
    before = samples.rgb.copy()
    develop(samples, CAMERA, 1, Daylight("noon", Light(), SKY))
    np.testing.assert_array_equal(samples.rgb, before)


def test_a_sun_of_its_own_is_turned_about_the_vertical_and_sometimes_clouded():
    drawn = daylights(DaylightSpec(sun=60.0), 60)
    suns = [daylight.sun for daylight in drawn if daylight.sun is not None]
    assert len(suns) == 60
    towards = np.array([sun.direction for sun in suns])
    np.testing.assert_allclose(np.linalg.norm(towards, axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(towards[:, 2], SUN[2], rtol=1e-6)
    turns = np.degrees(np.arctan2(towards[:, 1], towards[:, 0]) - np.arctan2(SUN[1], SUN[0]))
    assert 40 < np.abs((turns + 180) % 360 - 180).max() <= 60
    assert {sun.direct for sun in suns} == {DIRECT, CLOUD[0] * DIRECT}


def test_without_a_sun_of_its_own_nothing_is_drawn_that_was_not_before():
    for sunny, other in zip(
        daylights(DaylightSpec(sun=60.0), 1), daylights(DaylightSpec(), 1), strict=True
    ):
        assert other.sun is None
        assert (sunny.light, sunny.sky) == (other.light, other.sky)


def test_a_plain_sky_is_one_colour_in_every_direction():
    (daylight,) = daylights(DaylightSpec(sky=False, plain_sky=(0.1, 0.2, 0.3)), 1)
    assert daylight.sky is not None
    colors = daylight.sky.toward(np.random.default_rng(0).normal(size=(3, 20)))
    np.testing.assert_allclose(colors.T, np.tile([0.1, 0.2, 0.3], (20, 1)), rtol=1e-6)


def test_a_sun_beyond_half_a_turn_is_an_error():
    with pytest.raises(ConfigError, match="sun is 200"):
        DaylightSpec(sun=200.0)
