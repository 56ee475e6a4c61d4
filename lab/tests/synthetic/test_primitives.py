from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lab.synthetic.arrays import f32
from lab.synthetic.primitives import Box, Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import Plain

GREY = Plain((0.5, 0.5, 0.5))
ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
A, B = np.array([-0.5, 0.2, -0.3]), np.array([0.4, -0.1, 0.6])

Distance = Callable[[np.ndarray], np.ndarray]


def sphere_distance(p: np.ndarray) -> np.ndarray:
    return np.linalg.norm(p - A[:, None], axis=0) - 0.6


def capsule_distance(p: np.ndarray) -> np.ndarray:
    along = np.clip((B - A) @ (p - A[:, None]) / ((B - A) @ (B - A)), 0, 1)
    return np.linalg.norm(p - A[:, None] - along * (B - A)[:, None], axis=0) - 0.3


def box_distance(p: np.ndarray) -> np.ndarray:
    q = np.abs(ROTATION.T @ (p - B[:, None])) - np.array([[0.5], [0.3], [0.4]])
    return np.linalg.norm(np.maximum(q, 0), axis=0) + np.minimum(q.max(axis=0), 0)


SOLIDS = [
    pytest.param(Sphere(A, 0.6, GREY), sphere_distance, id="sphere"),
    pytest.param(Capsule(A, B, 0.3, GREY), capsule_distance, id="capsule"),
    pytest.param(Box(B, np.array([0.5, 0.3, 0.4]), ROTATION, GREY), box_distance, id="box"),
]


def rays(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """From points some 4 m away towards the middle, half of them near misses."""
    rng = np.random.default_rng(7)
    origins = rng.normal(size=(3, count))
    origins *= 4 / np.linalg.norm(origins, axis=0)
    directions = rng.uniform(-1.1, 1.1, (3, count)) - origins
    return origins.astype(np.float32), directions.astype(np.float32)


def march(distance: Distance, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Sphere tracing in float64: steps by the distance to the solid until it is reached."""
    o, d = origins.astype(np.float64), directions.astype(np.float64)
    speed, t = np.linalg.norm(d, axis=0), np.zeros(o.shape[1])
    for _ in range(2000):
        t = np.minimum(t + distance(o + t * d) / speed, 10)
    return np.where(np.abs(distance(o + t * d)) < 1e-9, t, np.inf)


@pytest.mark.parametrize(("solid", "distance"), SOLIDS)
def test_hits_agree_with_sphere_tracing(solid: Primitive, distance: Distance):
    origins, directions = rays()
    t, expected = solid.intersect(origins, directions), march(distance, origins, directions)
    # Rays within 1 mm of the outline may go either way in float32.
    steps = np.linspace(0, 2, 4001)
    gap = np.stack([distance(origins + s * directions.astype(np.float64)) for s in steps]).min(0)
    clear = np.abs(gap) > 1e-3
    assert (np.isfinite(t) == np.isfinite(expected))[clear].all()
    assert 0.1 < np.isfinite(expected).mean() < 0.9
    both = np.isfinite(t) & np.isfinite(expected) & clear
    np.testing.assert_allclose(t[both], expected[both], atol=2e-4)


@pytest.mark.parametrize(("solid", "distance"), SOLIDS)
def test_normals_are_the_gradient_of_the_distance(solid: Primitive, distance: Distance):
    origins, directions = rays()
    t = solid.intersect(origins, directions)
    points = (origins + t * directions)[:, np.isfinite(t)]
    normals, uv = solid.surface(points)
    # float32: 6e-8 times (4 m)^2 for the discriminant over the radius 0.3 m, some 30 operations.
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1, atol=1e-4)
    assert np.isfinite(uv).all()
    step = 1e-5
    gradient = np.stack(
        [
            (distance(points + step * e[:, None]) - distance(points - step * e[:, None]))
            for e in np.eye(3)
        ]
    ) / (2 * step)
    # Near edges of the box the gradient is that of either face.
    smooth = np.abs(np.linalg.norm(gradient, axis=0) - 1) < 1e-3
    assert smooth.mean() > 0.9
    agreement = (normals * gradient).sum(axis=0)[smooth]
    assert (agreement > 0.999).mean() > 0.98


@pytest.mark.parametrize(("solid", "distance"), SOLIDS)
def test_the_bounds_hold_the_solid(solid: Primitive, distance: Distance):
    center, radius = solid.bounds()
    points = np.random.default_rng(3).uniform(-2, 2, (3, 20000))
    inside = points[:, distance(points) < 0]
    assert (np.linalg.norm(inside - center[:, None], axis=0) <= radius).all()


def test_a_rectangle_is_met_inside_its_edges_only():
    square = Rect(np.array([0.0, 0, 1]), np.array([2.0, 0, 0]), np.array([0.0, 1, 0]), GREY)
    origins = f32([[0.5, 1.9, 2.1, 1.0], [0.5, 0.9, 0.5, -0.1], [0, 0, 0, 0]])
    t = square.intersect(origins, f32([[0], [0], [2]]))
    np.testing.assert_allclose(t, [0.5, 0.5, np.inf, np.inf])
    normals, uv = square.surface(origins[:, :2] + f32([[0], [0], [1]]))
    np.testing.assert_allclose(normals, [[0, 0], [0, 0], [1, 1]])
    np.testing.assert_allclose(uv, [[0.5, 1.9], [0.5, 0.9]], rtol=1e-6)


def test_nothing_behind_the_origin_is_met():
    ball = Sphere(np.array([0.0, 0, -3]), 1.0, GREY)
    up = f32([[0], [0], [1]])
    assert np.isinf(ball.intersect(f32([[0], [0], [0]]), up)).all()
    assert ball.intersect(f32([[0], [0], [0]]), -up) == pytest.approx(2)
