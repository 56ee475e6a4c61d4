"""What is drawn agrees with geometry."""

import numpy as np
import pytest

from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.primitives import Rect, Sphere
from lab.synthetic.render import AMBIENT, DIRECT, SUN, Casters, draw, in_shadow, shade, sky
from lab.synthetic.textures import Plain, f32

K = np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]])
CAMERA = PinholeCamera(K, look_at(np.array([0.0, -3, 0]), np.zeros(3)), 48, 32)
WHITE, RED = Plain((1.0, 1.0, 1.0)), Plain((1.0, 0.0, 0.0))


def test_a_ball_has_the_depth_and_the_outline_of_geometry():
    samples = draw([Sphere(np.zeros(3), 0.5, RED)], CAMERA, 3, sky(CAMERA, 3))
    assert samples.depth.min() == pytest.approx(2.5, abs=1e-3)
    # The outline is a circle of radius f tan(asin(r / d)); pi r^2 pixels, to one ring of samples.
    radius = 40 * np.tan(np.arcsin(0.5 / 3))
    area = samples.is_new.sum() / 9
    assert area == pytest.approx(np.pi * radius**2, abs=2 * np.pi * radius / 3)


def test_what_is_nearer_hides_what_is_farther_in_any_order():
    near, far = Sphere(np.zeros(3), 0.3, RED), Sphere(np.array([0.0, 1, 0]), 0.8, WHITE)
    first, other = (draw(pair, CAMERA, 1, sky(CAMERA, 1)) for pair in ([near, far], [far, near]))
    np.testing.assert_array_equal(first.rgb, other.rgb)
    assert first.rgb[1, 16, 24] == 0
    over = draw([near], CAMERA, 1, draw([far], CAMERA, 1, sky(CAMERA, 1)))
    np.testing.assert_array_equal(first.rgb, over.rgb)


def test_light_is_ambient_in_shadow_and_adds_the_sun_outside():
    ground = Rect(np.array([-5.0, -5, 0]), np.array([10.0, 0, 0]), np.array([0.0, 10, 0]), RED)
    ball = Sphere(2 * SUN.astype(np.float64), 0.3, WHITE)
    points = f32([[0, 3], [0, 3], [0, 0]])
    assert in_shadow(points, Casters([ball])).tolist() == [True, False]
    colors = shade(ground, points, Casters([ball]))
    np.testing.assert_allclose(colors[0], [AMBIENT, min(1, AMBIENT + DIRECT * SUN[2])], rtol=1e-6)
