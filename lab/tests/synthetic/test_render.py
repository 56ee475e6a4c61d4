from __future__ import annotations

import numpy as np
import pytest

from lab.synthetic.arrays import f32
from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.primitives import Rect, Sphere
from lab.synthetic.render import (
    AMBIENT,
    DIRECT,
    SUN,
    Casters,
    draw,
    in_shadow,
    shade,
    sky,
    to_pixels,
    to_uint8,
    window,
)
from lab.synthetic.textures import Plain

K = np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]])
WHITE, RED = Plain((1.0, 1.0, 1.0)), Plain((1.0, 0.0, 0.0))


@pytest.fixture
def camera() -> PinholeCamera:
    return PinholeCamera(K, look_at(np.array([0.0, -3, 0]), np.zeros(3)), 48, 32)


def test_a_ball_has_the_depth_and_the_outline_of_geometry(camera):
    ball = Sphere(np.zeros(3), 0.5, RED)
    samples = draw([ball], camera, 3, sky(camera, 3))
    assert samples.depth.min() == pytest.approx(2.5, abs=1e-3)
    # The outline is a circle of radius f tan(asin(r / d)); pi r^2 pixels, to one ring of samples.
    radius = 40 * np.tan(np.arcsin(0.5 / 3))
    area = samples.is_new.sum() / 9
    assert area == pytest.approx(np.pi * radius**2, abs=2 * np.pi * radius / 3)


def test_what_is_nearer_hides_what_is_farther_in_any_order(camera):
    near, far = Sphere(np.zeros(3), 0.3, RED), Sphere(np.array([0.0, 1, 0]), 0.8, WHITE)
    first, other = (draw(pair, camera, 1, sky(camera, 1)) for pair in ([near, far], [far, near]))
    np.testing.assert_array_equal(first.rgb, other.rgb)
    assert first.rgb[1, 16, 24] == 0
    over = draw([near], camera, 1, draw([far], camera, 1, sky(camera, 1)))
    np.testing.assert_array_equal(first.rgb, over.rgb)
    under = draw([far], camera, 1, draw([near], camera, 1, sky(camera, 1)))
    np.testing.assert_array_equal(first.rgb, under.rgb)
    assert under.is_new.sum() + over.is_new.sum() == first.is_new.sum()


def test_drawing_leaves_what_is_behind_unchanged(camera):
    behind = sky(camera, 1)
    before = behind.rgb.copy(), behind.depth.copy()
    draw([Sphere(np.zeros(3), 0.5, RED)], camera, 1, behind)
    np.testing.assert_array_equal(behind.rgb, before[0])
    np.testing.assert_array_equal(behind.depth, before[1])


@pytest.mark.parametrize("x", [-4.0, -1.2, 0.3, 1.6])
@pytest.mark.parametrize("y", [-2.6, -1.0, 2.0])
def test_the_window_holds_every_sample_that_a_ball_covers(camera, x, y):
    ball = Sphere(np.array([x, y, 0.4]), 0.5, RED)
    hit = np.isfinite(
        ball.intersect(f32(camera.position)[:, None, None], camera.rays(2)),
    )
    rows, columns = window(ball, camera, 2)
    inside = np.zeros_like(hit)
    inside[rows, columns] = True
    assert not (hit & ~inside).any()


def test_light_is_ambient_in_shadow_and_adds_the_sun_outside():
    ground = Rect(np.array([-5.0, -5, 0]), np.array([10.0, 0, 0]), np.array([0.0, 10, 0]), RED)
    ball = Sphere(2 * SUN.astype(np.float64), 0.3, WHITE)
    points = f32([[0, 3], [0, 3], [0, 0]])
    assert in_shadow(points, Casters([ball])).tolist() == [True, False]
    colors = shade(ground, points, Casters([ball]))
    np.testing.assert_allclose(colors[0], [AMBIENT, min(1, AMBIENT + DIRECT * SUN[2])], rtol=1e-6)
    np.testing.assert_array_equal(colors[1:], 0)


def test_nothing_shadows_itself():
    ball = Sphere(np.zeros(3), 1.0, WHITE)
    alone, nothing = (shade(ball, SUN[:, None], Casters(casters)) for casters in ([ball], []))
    np.testing.assert_array_equal(alone, nothing)


def test_pixels_are_means_of_their_samples_rounded_to_8_bits():
    samples = f32([[[0, 1, 0.2, 0.2], [0, 1, 0.2, 0.2]]])
    pixels = to_pixels(samples, 2)
    np.testing.assert_allclose(pixels[..., 0], [[0.5, 0.2]], rtol=1e-6)
    assert to_uint8(f32([[[0.2, 1.7, -0.1]]])).tolist() == [[[51, 255, 0]]]
