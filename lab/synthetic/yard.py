"""The static scene: a walled yard with things standing about in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lab.synthetic.primitives import Box, Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import Bricks, Checker, Dots, Grained, Plain, Stripes, Texture

HALF_WIDTH, BACK, FRONT = 7.0, 4.0, -7.5
"""Extent of the yard in metres: x from -HALF_WIDTH to HALF_WIDTH, y from FRONT to BACK."""


def turn_z(angle: float) -> np.ndarray:
    """Rotation about the vertical, radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def box(
    xy: tuple[float, float], bottom: float, size: Sequence[float], angle: float, texture: Texture
) -> Box:
    """An upright box; metres, radians."""
    half = np.array(size) / 2
    return Box(np.array([*xy, bottom + half[2]]), half, turn_z(angle), texture)


def post(xy: tuple[float, float], height: float, radius: float, texture: Texture) -> Capsule:
    """An upright post that stands on the ground; metres."""
    start, end = np.array([*xy, 0.0]), np.array([*xy, height - radius])
    return Capsule(start, end, radius, texture)


def walls_and_ground(wall_height: float) -> list[Primitive]:
    """Ground and three walls; the sky shows above walls lower than some 4 metres."""
    width, depth = np.array([2 * HALF_WIDTH, 0.0, 0.0]), np.array([0.0, BACK - FRONT, 0.0])
    up = np.array([0.0, 0.0, wall_height])
    corner = np.array([-HALF_WIDTH, FRONT, 0.0])
    slabs = Bricks((0.88, 0.83, 0.72), (0.62, 0.57, 0.5), (0.95, 0.7), 0.04, 0.3, 0.5, seed=4)
    bricks = Bricks((0.85, 0.5, 0.37), (0.72, 0.6, 0.52), (0.8, 0.36), 0.05, 0.45, seed=5)
    stone = Bricks((0.86, 0.9, 0.96), (0.62, 0.64, 0.68), (1.1, 0.5), 0.05, 0.35, seed=6)
    plaster = Stripes((0.96, 0.86, 0.56), (0.9, 0.72, 0.42), 0.5, np.pi / 2)
    return [
        Rect(corner, width, depth, Grained(slabs, 0.25, (0.6, 0.6), 10)),
        Rect(corner + depth, width, up, Grained(bricks, 0.25, (1.1, 0.7), 12)),
        Rect(corner, depth, up, Grained(stone, 0.3, (0.8, 0.5), 14)),
        Rect(corner + width + depth, -depth, up, Grained(plaster, 0.35, (0.5, 0.9), 16)),
    ]


def furniture() -> list[Primitive]:
    """What stands in the yard and casts shadows."""
    wood = Grained(Plain((0.78, 0.56, 0.34)), 0.5, (0.5, 0.05), 20)
    crate = Grained(Stripes((0.72, 0.54, 0.34), (0.5, 0.36, 0.22), 0.12), 0.3, (0.3, 0.04), 22)
    marble = Grained(Plain((0.95, 0.94, 0.9)), 0.45, (0.35, 0.12), 24)
    leaves = Grained(Plain((0.36, 0.66, 0.28)), 0.8, (0.1, 0.1), 26)
    clay = Grained(Stripes((0.8, 0.42, 0.28), (0.66, 0.32, 0.2), 0.07), 0.2, (0.2, 0.2), 28)
    cube = Checker((0.2, 0.4, 0.7), (0.93, 0.93, 0.93), 0.14)
    board = Checker((0.85, 0.7, 0.3), (0.3, 0.45, 0.35), 0.32)
    harlequin = Checker((0.95, 0.6, 0.15), (0.3, 0.2, 0.5), 0.12)
    ball = Stripes((0.95, 0.3, 0.22), (0.98, 0.92, 0.7), 0.2, np.pi / 2)
    return [
        box((0.0, 0.2), 0.0, (1.3, 1.0, 0.7), 0.35, marble),
        Sphere(np.array([0.0, 0.2, 1.25]), 0.55, Grained(ball, 0.15, (0.2, 0.2), 30)),
        box((-1.9, 0.9), 0.0, (0.9, 0.9, 0.9), 0.6, crate),
        box((-1.85, 0.95), 0.9, (0.55, 0.55, 0.55), 0.1, cube),
        box((2.0, 1.2), 0.0, (1.5, 0.6, 0.5), -0.5, wood),
        Sphere(np.array([2.0, 1.2, 0.8]), 0.3, Dots((0.98, 0.85, 0.2), (0.25, 0.3, 0.6), 0.16)),
        post((1.35, -0.75), 0.62, 0.26, clay),
        Sphere(np.array([1.35, -0.75, 0.82]), 0.36, leaves),
        post((-1.2, -0.9), 0.75, 0.13, Stripes((0.9, 0.2, 0.2), (0.95, 0.95, 0.95), 0.15)),
        post((-3.3, 2.3), 3.2, 0.28, Stripes((0.25, 0.55, 0.55), (0.9, 0.86, 0.75), 0.3, 0.6)),
        post((3.6, 2.5), 3.2, 0.28, Stripes((0.6, 0.3, 0.5), (0.9, 0.86, 0.75), 0.3, -0.6)),
        box((0.7, 3.3), 0.0, (1.6, 0.5, 1.9), 0.0, board),
        Sphere(np.array([-0.75, -0.35, 0.22]), 0.22, harlequin),
    ]
