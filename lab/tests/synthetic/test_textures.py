from __future__ import annotations

import numpy as np
import pytest

from lab.synthetic.textures import (
    Bricks,
    Checker,
    Dots,
    Grained,
    Plain,
    Stripes,
    hash_noise,
    value_noise,
)

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def is_first(colors: np.ndarray) -> list[bool]:
    return (colors[0] == 1).tolist()


def test_a_checker_changes_colour_with_every_square():
    uv = np.array([[0.25, 0.75, 0.75, -0.25], [0.25, 0.25, 0.75, 0.25]])
    assert is_first(Checker(RED, BLUE, 0.5)(uv)) == [True, False, True, False]


def test_stripes_run_along_the_first_coordinate_until_turned():
    uv = np.array([[0.1, 0.9, 0.1], [0.25, 0.25, 0.75]])
    assert is_first(Stripes(RED, BLUE, 0.5)(uv)) == [True, True, False]
    assert is_first(Stripes(RED, BLUE, 0.5, np.pi / 2)(uv)) == [True, False, True]


def test_dots_have_half_the_pitch_as_diameter():
    uv = np.array([[0.5, 0.74, 0.76], [0.5, 0.5, 0.5]])
    assert is_first(Dots(RED, BLUE, 1.0)(uv)) == [True, True, False]


def test_bricks_have_joints_and_every_other_course_is_shifted():
    bricks = Bricks(RED, BLUE, (1.0, 0.5), 0.1, shade=0.0)
    uv = np.array([[0.05, 0.5, 0.5, 0.55, 0.75], [0.25, 0.25, 0.05, 0.75, 0.75]])
    assert is_first(bricks(uv)) == [False, True, False, False, True]


def test_noise_takes_the_lattice_values_at_integers_and_stays_between_neighbours():
    cells = np.array([[0, 1, 5, -3], [0, 2, 70, 4]])
    np.testing.assert_array_equal(value_noise(cells.astype(float), 3), hash_noise(cells, 3))
    uv = np.random.default_rng(0).uniform(-5, 5, (2, 500))
    low = np.floor(uv).astype(int)
    corners = [hash_noise(low + np.array([[i], [j]]), 3) for i in (0, 1) for j in (0, 1)]
    noise = value_noise(uv, 3)
    assert (noise >= np.min(corners, axis=0) - 1e-6).all()
    assert (noise <= np.max(corners, axis=0) + 1e-6).all()


def test_noise_is_continuous_across_cells():
    edge = np.linspace(0.1, 0.9, 9)
    left, right = np.stack([np.full(9, 2 - 1e-9), edge]), np.stack([np.full(9, 2.0), edge])
    np.testing.assert_allclose(value_noise(left, 1), value_noise(right, 1), atol=1e-7)


@pytest.mark.parametrize("strength", [0.0, 0.5])
def test_grain_changes_brightness_within_its_strength_and_not_hue(strength):
    uv = np.random.default_rng(1).uniform(0, 9, (2, 400))
    colors = Grained(Plain((0.4, 0.2, 0.1)), strength, (0.5, 0.5))(uv)
    brightness = colors[0] / 0.4
    assert np.ptp(brightness) <= strength + 1e-6
    assert (np.ptp(brightness) > 0.2) == (strength > 0)
    np.testing.assert_allclose(colors[1] / colors[0], 0.5, rtol=1e-6)
