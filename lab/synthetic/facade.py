"""A static scene whose middle is easy and whose rest is bare: a house behind a lawn."""

from __future__ import annotations

import numpy as np

from lab.synthetic.cameras import Stand
from lab.synthetic.primitives import Primitive, Rect, Sphere
from lab.synthetic.textures import Bricks, Grained, Plain, Texture
from lab.synthetic.yard import box, post

STAND = Stand(distance=20.0, sway=0.8, height=(1.5, 1.9), target=(0.0, 0.0, 2.3), aim=0.3)
"""Of somebody who walks past at some twenty metres."""

WIDTH, DEPTH = 15.0, 6.0
"""Of the house in metres; its front is the plane y = 0, the pavilion stands before it."""

EAVES, RIDGE = 4.4, 6.2
"""Heights of the wings' roof, metres."""

HALF = 60.0
"""The lawn reaches from -HALF to HALF along x and y, metres."""


def lawn_and_path() -> list[Primitive]:
    """Short grass, which hardly has a structure from so far, and a gravel path to the door."""
    grass = Grained(Plain((0.36, 0.52, 0.22)), 0.08, (4.0, 4.0), 60)
    gravel = Grained(Plain((0.8, 0.76, 0.68)), 0.05, (2.0, 2.0), 62)
    side, up = 2 * HALF, 0.01
    return [
        Rect(np.array([-HALF, -HALF, 0.0]), np.array([side, 0, 0]), np.array([0, side, 0]), grass),
        Rect(np.array([-1.6, -HALF, up]), np.array([3.2, 0, 0]), np.array([0, HALF, 0]), gravel),
        Rect(np.array([-12.0, -4.0, up]), np.array([24.0, 0, 0]), np.array([0, 2.2, 0]), gravel),
    ]


def house_and_trees() -> list[Primitive]:
    """What stands on the lawn and casts shadows."""
    return [*_house(), *_trees()]


def _window(x: float, y: float, bottom: float, size: tuple[float, float], seed: int) -> list:
    """Panes between white bars, a frame and a sill; `y` is that of the wall, metres."""
    width, height = size
    panes = Bricks((0.3, 0.34, 0.4), (0.9, 0.88, 0.83), (0.42, 0.5), 0.07, 0.6, 0.0, seed)
    stone = Grained(Plain((0.92, 0.88, 0.78)), 0.2, (0.2, 0.2), 64)
    left = x - width / 2
    pane = Rect(
        np.array([left, y - 0.02, bottom]), np.array([width, 0, 0]), np.array([0, 0, height]), panes
    )
    sill = box((x, y - 0.08), bottom - 0.14, (width + 0.3, 0.3, 0.14), 0.0, stone)
    lintel = box((x, y - 0.05), bottom + height, (width + 0.3, 0.2, 0.16), 0.0, stone)
    sides = [
        box((x + s, y - 0.05), bottom, (0.14, 0.2, height), 0.0, stone)
        for s in (-width / 2 - 0.07, width / 2 + 0.07)
    ]
    return [pane, sill, lintel, *sides]


def _roof(left: float, width: float, front: float, eaves: float, ridge: float) -> Rect:
    """The slope of slates that one sees from the lawn."""
    slates = Grained(
        Bricks((0.42, 0.46, 0.54), (0.3, 0.33, 0.4), (0.5, 0.3), 0.03, 0.4, seed=66),
        0.4,
        (0.8, 0.8),
        68,
    )
    slope = np.array([0.0, 1.6, ridge - eaves])
    return Rect(np.array([left, front - 0.2, eaves]), np.array([width, 0, 0]), slope, slates)


def _house() -> list[Primitive]:
    ashlar = Bricks((0.88, 0.8, 0.64), (0.72, 0.65, 0.52), (0.9, 0.4), 0.04, 0.25, seed=70)
    wall: Texture = Grained(ashlar, 0.35, (0.7, 0.5), 72)
    brick = Grained(
        Bricks((0.72, 0.42, 0.32), (0.7, 0.62, 0.55), (0.4, 0.2), 0.03, seed=74),
        0.3,
        (0.5, 0.4),
        76,
    )
    stone = Grained(Plain((0.93, 0.89, 0.8)), 0.3, (0.3, 0.2), 78)
    oak = Bricks((0.4, 0.26, 0.16), (0.24, 0.15, 0.1), (0.4, 0.55), 0.06, 0.3, 0.0, 80)
    parts: list[Primitive] = [
        box((0.0, DEPTH / 2), 0.0, (WIDTH, DEPTH, EAVES), 0.0, wall),
        box((0.0, DEPTH / 2 - 1.0), 0.0, (4.6, DEPTH, 5.6), 0.0, wall),
        _roof(-WIDTH / 2 - 0.2, WIDTH + 0.4, 0.0, EAVES, RIDGE),
        _roof(-2.6, 5.2, -1.0, 5.6, 7.4),
        box((0.0, -0.06), EAVES - 0.25, (WIDTH + 0.2, 0.3, 0.25), 0.0, stone),
        box((0.0, -1.06), 5.35, (4.9, 0.3, 0.25), 0.0, stone),
        box((0.0, -1.05), 0.0, (1.3, 0.16, 2.5), 0.0, oak),
        box((0.0, -1.6), 0.0, (2.6, 1.2, 0.2), 0.0, stone),
        box((-5.2, 1.9), 5.2, (0.9, 0.7, 2.1), 0.0, brick),
        box((4.8, 1.9), 5.2, (0.9, 0.7, 2.1), 0.0, brick),
    ]  # fmt: skip
    for number, x in enumerate((-6.6, -5.0, -3.4, 3.4, 5.0, 6.6)):
        parts += _window(x, 0.0, 0.6, (0.9, 1.5), 82 + number)
        parts += _window(x, 0.0, 2.7, (0.9, 1.2), 92 + number)
    for number, x in enumerate((-1.5, 1.5)):
        parts += _window(x, -1.0, 0.7, (0.8, 1.7), 102 + number)
    for number, x in enumerate((-1.5, 0.0, 1.5)):
        parts += _window(x, -1.0, 3.3, (0.8, 1.4), 112 + number)
    for x in (-WIDTH / 2, -2.5, 2.5, WIDTH / 2):
        parts.append(box((x, -0.05 if abs(x) > 3 else -1.0), 0.0, (0.4, 0.3, EAVES), 0.0, stone))
    return parts


def _tree(xy: tuple[float, float], height: float, crown: float, seed: int) -> list[Primitive]:
    bark = Grained(Plain((0.36, 0.29, 0.22)), 1.0, (0.1, 0.5), seed)
    leaves = Grained(Plain((0.26, 0.4, 0.16)), 1.5, (0.3, 0.3), seed + 2)
    top = np.array([*xy, height - crown])
    shifts = [(0, 0, 0), (0.7, 0.1, -0.4), (-0.6, 0.2, -0.3), (0.1, -0.5, -0.6)]
    balls = [Sphere(top + crown * np.array(s), 0.75 * crown, leaves) for s in shifts]
    return [post(xy, height - crown, 0.22, bark), *balls]


def _trees() -> list[Primitive]:
    """Beside the lawn, where only photos from the end of the walk show them, and far behind."""
    near = [((7.3, -10.3), 5.5, 1.4), ((-7.0, -10.8), 5.0, 1.4), ((9.6, -5.0), 7.0, 1.8),
            ((-9.8, -5.5), 6.5, 1.8)]  # fmt: skip
    far = [((x, 22.0 + (x % 3)), 7.0 + x % 2, 3.0) for x in np.arange(-42.0, 43.0, 3.6).tolist()]
    return [
        part
        for number, (xy, height, crown) in enumerate([*near, *far])
        for part in _tree(xy, height, crown, 120 + 4 * (number % 8))
    ]
