"""A static scene that is hard to hold in place: glossy things between bare walls, indoors."""

from __future__ import annotations

import numpy as np

from lab.synthetic.primitives import Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import (
    BARE_WALL,
    Checker,
    Glossy,
    Grained,
    Plain,
    Stripes,
)
from lab.synthetic.yard import box, post

HALF = 6.5
"""The room reaches from -HALF to HALF along x and y, metres; cameras stand 5 m from its middle."""


def walls_and_floor(wall_height: float) -> list[Primitive]:
    """Four walls of one colour, the floor of worn planks; no ceiling."""
    side, up = 2 * HALF, np.array([0.0, 0.0, wall_height])
    planks = Stripes((0.62, 0.5, 0.38), (0.56, 0.44, 0.33), 0.4)
    floor = Grained(planks, 0.25, (1.5, 0.2), 40)
    corner, x, y = np.array([-HALF, -HALF, 0.0]), np.array([side, 0, 0]), np.array([0, side, 0.0])
    r, g, b = BARE_WALL
    shades = [Plain((s * r, s * g, s * b)) for s in (1.0, 0.96, 1.04, 0.98)]
    return [
        Rect(corner, x, y, floor),
        Rect(corner + y, x, up, shades[0]),
        Rect(corner, y, up, shades[1]),
        Rect(corner + x + y, -y, up, shades[2]),
        Rect(corner + x, -x, up, shades[3]),
    ]


def glossy_things() -> list[Primitive]:
    """What stands in the middle."""
    lacquer = Glossy(Grained(Plain((0.55, 0.08, 0.07)), 0.15, (0.3, 0.3), 42), 0.6)
    steel = Glossy(Plain((0.3, 0.32, 0.36)), 0.9)
    enamel = Glossy(Checker((0.15, 0.3, 0.55), (0.85, 0.85, 0.8), 0.25), 0.5)
    leather = Grained(Plain((0.2, 0.14, 0.1)), 0.4, (0.1, 0.1), 44)
    chart = Checker((0.9, 0.9, 0.9), (0.2, 0.2, 0.2), 0.2)
    poster = Stripes((0.8, 0.3, 0.2), (0.2, 0.4, 0.45), 0.22, 0.5)
    return [
        box((0.0, 0.0), 0.35, (1.9, 0.8, 0.5), 0.3, lacquer),
        box((0.0, 0.0), 0.85, (0.9, 0.7, 0.35), 0.3, leather),
        Sphere(np.array([0.75, 0.25, 0.38]), 0.38, steel),
        Sphere(np.array([-0.75, -0.25, 0.38]), 0.38, steel),
        Capsule(np.array([-1.0, 0.4, 0.15]), np.array([-0.2, 1.0, 0.15]), 0.15, enamel),
        post((1.3, -1.0), 1.5, 0.1, enamel),
        post((-1.4, 1.2), 1.1, 0.22, Grained(Plain((0.3, 0.5, 0.25)), 0.8, (0.1, 0.1), 46)),
        box((0.2, HALF - 0.05), 1.0, (1.4, 0.06, 1.0), 0.0, poster),
        box((HALF - 0.05, -1.0), 1.1, (0.06, 1.0, 0.8), 0.0, chart),
    ]
