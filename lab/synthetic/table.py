"""A static scene with two depths: things on a table, and a room far behind them.

Everything is three times as large as life: cameras then stand as far away as in the yard, and what
passes before them there fits here.
"""

from __future__ import annotations

import numpy as np

from lab.synthetic.cameras import Stand
from lab.synthetic.primitives import Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import BARE_WALL, Bricks, Checker, Dots, Grained, Plain, Stripes
from lab.synthetic.yard import box, post, turn_z

STAND = Stand(sway=0.5, height=(1.6, 2.5), target=(0.0, 0.0, 0.55))
"""Of somebody who walks around the table and looks down at it."""

FLOOR, HALF = -2.3, 14.0
"""Height of the floor under the table-top, which is z = 0, and how far away the walls are."""


def room_behind() -> list[Primitive]:
    """Bare walls and floor, a window, a door, a shelf and chairs."""
    return [*_walls(), *_furniture()]


def _walls() -> list[Primitive]:
    side, up, corner = 2 * HALF, np.array([0.0, 0.0, 9.0]), np.array([-HALF, -HALF, FLOOR])
    x, y = np.array([side, 0.0, 0.0]), np.array([0.0, side, 0.0])
    r, g, b = BARE_WALL
    shades = [Plain((s * r, s * g, s * b)) for s in (1.0, 0.94, 1.04, 0.97)]
    floor = Grained(Plain((0.6, 0.52, 0.44)), 0.1, (6.0, 6.0), 130)
    return [
        Rect(corner, x, y, floor),
        Rect(corner + y, x, up, shades[0]),
        Rect(corner, y, up, shades[1]),
        Rect(corner + x + y, -y, up, shades[2]),
        Rect(corner + x, -x, up, shades[3]),
    ]


def _chair(xy: tuple[float, float], angle: float) -> list[Primitive]:
    """A seat, a back and legs; the back is away from the table where `angle` is its azimuth."""
    wood = Grained(Plain((0.5, 0.32, 0.2)), 0.15, (1.5, 1.5), 132)
    seat = box(xy, FLOOR + 1.4, (1.3, 1.3, 0.15), angle, wood)
    ahead = turn_z(angle)
    back_xy = np.array(xy) + (ahead @ np.array([0.6, 0.0, 0.0]))[:2]
    back = box((back_xy[0], back_xy[1]), FLOOR + 1.55, (0.12, 1.3, 1.4), angle, wood)
    legs: list[Primitive] = []
    for s, t in ((-0.55, -0.55), (-0.55, 0.55), (0.55, -0.55), (0.55, 0.55)):
        foot = np.array(xy) + (ahead @ np.array([s, t, 0.0]))[:2]
        start = np.array([*foot, FLOOR])
        legs.append(Capsule(start, start + np.array([0.0, 0.0, 1.4]), 0.08, wood))
    return [seat, back, *legs]


def _furniture() -> list[Primitive]:
    white, oak = Plain((0.93, 0.93, 0.9)), Grained(Plain((0.55, 0.4, 0.26)), 0.2, (2.0, 2.0), 134)
    panes = Bricks((0.97, 0.98, 1.0), (0.8, 0.78, 0.74), (1.7, 2.2), 0.18, 0.06, 0.0, 136)
    books = Bricks((0.75, 0.5, 0.4), (0.25, 0.18, 0.14), (0.3, 1.5), 0.05, 0.9, 0.3, 138)
    curtain = Stripes((0.62, 0.66, 0.72), (0.56, 0.6, 0.67), 0.6, np.pi / 2)
    edge = HALF - 0.05
    parts: list[Primitive] = [
        box((-1.0, edge), 0.4, (5.1, 0.06, 4.4), 0.0, panes),
        box((-4.6, edge - 0.1), FLOOR + 0.3, (1.8, 0.2, 7.5), 0.0, curtain),
        box((2.6, edge - 0.1), FLOOR + 0.3, (1.8, 0.2, 7.5), 0.0, curtain),
        box((-edge + 0.4, 3.0), FLOOR, (0.8, 4.0, 5.0), 0.0, books),
        box((-edge + 0.5, -5.0), FLOOR, (1.0, 3.0, 2.4), 0.0, oak),
        box((edge, 2.0), FLOOR, (0.08, 2.8, 6.0), 0.0, oak),
        box((edge - 0.5, -5.5), FLOOR, (1.0, 3.6, 2.6), 0.0, white),
        box((9.5, 11.0), FLOOR, (2.4, 1.6, 3.0), 0.2, oak),
        post((7.5, -11.0), 2.2, 0.5, Plain((0.3, 0.42, 0.3))),
    ]
    for xy, angle in (
        ((1.5, 8.5), 1.4),
        ((-8.0, 6.5), 2.4),
        ((8.5, 4.0), 0.5),
        ((-9.0, -2.5), 3.4),
    ):
        parts += _chair(xy, angle)
    return parts


def table_and_toy() -> list[Primitive]:
    """The table with its cloth, a toy digger and what else stands there; casts shadows."""
    walnut = Grained(Stripes((0.58, 0.38, 0.24), (0.52, 0.33, 0.2), 0.35), 0.5, (0.8, 0.08), 140)
    cloth = Grained(Checker((0.85, 0.25, 0.22), (0.93, 0.9, 0.84), 0.22), 0.3, (0.15, 0.15), 142)
    yellow = Grained(Plain((0.95, 0.75, 0.15)), 0.35, (0.2, 0.12), 144)
    tracks = Bricks((0.25, 0.25, 0.26), (0.08, 0.08, 0.08), (0.16, 0.3), 0.05, 0.5, seed=146)
    cab = Checker((0.2, 0.3, 0.42), (0.9, 0.72, 0.2), 0.17)
    spots = Dots((0.95, 0.95, 0.9), (0.2, 0.35, 0.6), 0.2)
    rings = Stripes((0.25, 0.5, 0.45), (0.92, 0.88, 0.75), 0.12)
    print_ = Bricks((0.9, 0.88, 0.8), (0.2, 0.22, 0.3), (0.35, 0.12), 0.03, 0.5, seed=148)
    apple = Grained(Plain((0.7, 0.2, 0.12)), 0.9, (0.15, 0.3), 150)
    pear = Grained(Plain((0.6, 0.65, 0.2)), 0.7, (0.12, 0.2), 152)
    straw = Grained(Stripes((0.72, 0.55, 0.3), (0.5, 0.35, 0.18), 0.06, 0.8), 0.4, (0.1, 0.1), 154)
    top = box((0.0, 0.0), -0.18, (6.0, 4.4, 0.18), 0.0, walnut)
    turn, corner = turn_z(0.5), np.array([-0.1, -1.6, 0.005])
    across, along = turn @ np.array([2.2, 0.0, 0.0]), turn @ np.array([0.0, 2.2, 0.0])
    parts: list[Primitive] = [top, Rect(corner, across, along, cloth)]
    for x, y in ((-2.7, -1.9), (-2.7, 1.9), (2.7, -1.9), (2.7, 1.9)):
        parts.append(box((x, y), FLOOR, (0.25, 0.25, -FLOOR - 0.18), 0.0, walnut))
    for side in (-0.42, 0.42):
        track_xy = (turn_z(0.3) @ np.array([0.0, side, 0.0]))[:2] + np.array([-0.3, 0.3])
        parts.append(box((track_xy[0], track_xy[1]), 0.0, (1.7, 0.3, 0.38), 0.3, tracks))
    shovel = np.array([-0.3, 0.3, 0.0]) + turn_z(0.3) @ np.array([1.15, 0.0, 0.0])
    elbow = np.array([-0.3, 0.3, 1.35]) + turn_z(0.3) @ np.array([0.75, 0.0, 0.0])
    return [
        *parts,
        box((-0.3, 0.3), 0.38, (1.4, 0.8, 0.35), 0.3, yellow),
        box((-0.6, 0.2), 0.73, (0.6, 0.65, 0.55), 0.3, cab),
        Capsule(np.array([-0.1, 0.35, 0.75]), elbow, 0.09, yellow),
        Capsule(elbow, np.array([*shovel[:2], 0.4]), 0.08, yellow),
        box((shovel[0], shovel[1]), 0.05, (0.35, 0.75, 0.4), 0.3, tracks),
        post((1.7, 0.9), 0.75, 0.3, rings),
        Sphere(np.array([-1.8, -0.7, 0.33]), 0.33, apple),
        Sphere(np.array([-1.35, -1.15, 0.29]), 0.29, pear),
        box((-1.9, 1.2), 0.0, (1.1, 0.8, 0.22), -0.4, print_),
        box((-1.85, 1.15), 0.22, (0.9, 0.65, 0.18), -0.1, straw),
        Sphere(np.array([0.9, -0.9, 0.24]), 0.24, spots),
        box((0.3, 1.5), 0.0, (0.7, 0.4, 0.9), 0.2, spots),
    ]
