"""The static scenes: a yard, a bare room, a grove, a house behind a lawn, a table before a room.

Metres; z is up, and the cameras stand around the middle. Each number after a texture's colours is a
size or the seed of its noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lab.synthetic.cameras import IN_THE_YARD, Stand
from lab.synthetic.primitives import Box, Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import (
    Bricks,
    Checker,
    Color,
    Dots,
    Glossy,
    Grained,
    Plain,
    Stripes,
    Texture,
)

BARE, BARE_INDOORS = 2.0, 0.02
"""Slope of grey (of 255 per pixel) that a place without structure counts as where points are
sought."""

ROOM, GROVE, LAWN = 6.5, 12.0, 60.0
"""How far the room, the grove and the lawn reach from the middle along x and y."""

TABLE_ROOM, FLOOR = 14.0, -2.3
"""How far the walls of the room behind the table are, and the height of its floor under the
table-top, which is z = 0."""

WIDTH, DEPTH, EAVES, RIDGE = 15.0, 6.0, 4.4, 6.2
"""Of the house: its front is the plane y = 0, the pavilion stands before it."""


Vector = Sequence[float] | np.ndarray


def turn_z(angle: float) -> np.ndarray:
    """Rotation about the vertical, radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def box(xy: Vector, bottom: float, size: Sequence[float], angle: float, texture: Texture) -> Box:
    """An upright box, turned about the vertical by `angle` (radians)."""
    half = np.array(size) / 2
    return Box(np.array([*xy, bottom + half[2]]), half, turn_z(angle), texture)


def rod(start: Vector, end: Vector, radius: float, texture: Texture) -> Capsule:
    return Capsule(np.array(start), np.array(end), radius, texture)


def post(xy: Vector, height: float, radius: float, texture: Texture) -> Capsule:
    """An upright rod that stands on the ground."""
    return rod([*xy, 0.0], [*xy, height - radius], radius, texture)


def ball(center: Vector, radius: float, texture: Texture) -> Sphere:
    return Sphere(np.array(center), radius, texture)


def rect(corner: Vector, u: Vector, v: Vector, texture: Texture) -> Primitive:
    return Rect(np.array(corner, float), np.array(u, float), np.array(v, float), texture)


def grained(color: Color, strength: float, scale: tuple[float, float], seed: int) -> Grained:
    return Grained(Plain(color), strength, scale, seed)


def walled(
    corner: Sequence[float], size: Sequence[float], textures: Sequence[Texture]
) -> list[Primitive]:
    """The floor, then walls while there are textures: behind, left, right, in front."""
    start, (x, y, up) = np.array(corner), np.diag(size)
    sides = [(start, x, y), (start + y, x, up), (start, y, up)]
    sides += [(start + x + y, -y, up), (start + x, -x, up)]
    placed = zip(sides, textures, strict=False)
    return [Rect(start, u, v, texture) for (start, u, v), texture in placed]


def bare_room(
    half: float, bottom: float, height: float, shades: Sequence[float], floor: Texture
) -> list[Primitive]:
    """A floor, and four walls of one colour in several shades."""
    walls = [Plain((0.84 * shade, 0.82 * shade, 0.78 * shade)) for shade in shades]
    return walled((-half, -half, bottom), (2 * half, 2 * half, height), [floor, *walls])


# --- yard --------------------------------------------------------------------------------------


def walls_and_ground(wall_height: float) -> list[Primitive]:
    """Ground and three walls; the sky shows above walls lower than some 4 metres."""
    slabs = Bricks((0.88, 0.83, 0.72), (0.62, 0.57, 0.5), (0.95, 0.7), 0.04, 0.3, 0.5, seed=4)
    bricks = Bricks((0.85, 0.5, 0.37), (0.72, 0.6, 0.52), (0.8, 0.36), 0.05, 0.45, seed=5)
    stone = Bricks((0.86, 0.9, 0.96), (0.62, 0.64, 0.68), (1.1, 0.5), 0.05, 0.35, seed=6)
    plaster = Stripes((0.96, 0.86, 0.56), (0.9, 0.72, 0.42), 0.5, np.pi / 2)
    textures = [
        Grained(slabs, 0.25, (0.6, 0.6), 10),
        Grained(bricks, 0.25, (1.1, 0.7), 12),
        Grained(stone, 0.3, (0.8, 0.5), 14),
        Grained(plaster, 0.35, (0.5, 0.9), 16),
    ]
    return walled((-7.0, -7.5, 0.0), (14.0, 11.5, wall_height), textures)


def furniture() -> list[Primitive]:
    """What stands in the yard."""
    wood = grained((0.78, 0.56, 0.34), 0.5, (0.5, 0.05), 20)
    crate = Grained(Stripes((0.72, 0.54, 0.34), (0.5, 0.36, 0.22), 0.12), 0.3, (0.3, 0.04), 22)
    marble = grained((0.95, 0.94, 0.9), 0.45, (0.35, 0.12), 24)
    leaves = grained((0.36, 0.66, 0.28), 0.8, (0.1, 0.1), 26)
    clay = Grained(Stripes((0.8, 0.42, 0.28), (0.66, 0.32, 0.2), 0.07), 0.2, (0.2, 0.2), 28)
    cube = Checker((0.2, 0.4, 0.7), (0.93, 0.93, 0.93), 0.14)
    board = Checker((0.85, 0.7, 0.3), (0.3, 0.45, 0.35), 0.32)
    harlequin = Checker((0.95, 0.6, 0.15), (0.3, 0.2, 0.5), 0.12)
    striped = Stripes((0.95, 0.3, 0.22), (0.98, 0.92, 0.7), 0.2, np.pi / 2)
    return [
        box((0.0, 0.2), 0.0, (1.3, 1.0, 0.7), 0.35, marble),
        ball((0.0, 0.2, 1.25), 0.55, Grained(striped, 0.15, (0.2, 0.2), 30)),
        box((-1.9, 0.9), 0.0, (0.9, 0.9, 0.9), 0.6, crate),
        box((-1.85, 0.95), 0.9, (0.55, 0.55, 0.55), 0.1, cube),
        box((2.0, 1.2), 0.0, (1.5, 0.6, 0.5), -0.5, wood),
        ball((2.0, 1.2, 0.8), 0.3, Dots((0.98, 0.85, 0.2), (0.25, 0.3, 0.6), 0.16)),
        post((1.35, -0.75), 0.62, 0.26, clay),
        ball((1.35, -0.75, 0.82), 0.36, leaves),
        post((-1.2, -0.9), 0.75, 0.13, Stripes((0.9, 0.2, 0.2), (0.95, 0.95, 0.95), 0.15)),
        post((-3.3, 2.3), 3.2, 0.28, Stripes((0.25, 0.55, 0.55), (0.9, 0.86, 0.75), 0.3, 0.6)),
        post((3.6, 2.5), 3.2, 0.28, Stripes((0.6, 0.3, 0.5), (0.9, 0.86, 0.75), 0.3, -0.6)),
        box((0.7, 3.3), 0.0, (1.6, 0.5, 1.9), 0.0, board),
        ball((-0.75, -0.35, 0.22), 0.22, harlequin),
    ]


# --- room --------------------------------------------------------------------------------------


def walls_and_floor(wall_height: float) -> list[Primitive]:
    """Four bare walls, the floor of worn planks; no ceiling."""
    planks = Grained(Stripes((0.62, 0.5, 0.38), (0.56, 0.44, 0.33), 0.4), 0.25, (1.5, 0.2), 40)
    return bare_room(ROOM, 0.0, wall_height, (1.0, 0.96, 1.04, 0.98), planks)


def glossy_things() -> list[Primitive]:
    """What stands in the middle of the room, and two posters."""
    lacquer = Glossy(grained((0.55, 0.08, 0.07), 0.15, (0.3, 0.3), 42), 0.6)
    steel = Glossy(Plain((0.3, 0.32, 0.36)), 0.9)
    enamel = Glossy(Checker((0.15, 0.3, 0.55), (0.85, 0.85, 0.8), 0.25), 0.5)
    leather = grained((0.2, 0.14, 0.1), 0.4, (0.1, 0.1), 44)
    chart = Checker((0.9, 0.9, 0.9), (0.2, 0.2, 0.2), 0.2)
    poster = Stripes((0.8, 0.3, 0.2), (0.2, 0.4, 0.45), 0.22, 0.5)
    return [
        box((0.0, 0.0), 0.35, (1.9, 0.8, 0.5), 0.3, lacquer),
        box((0.0, 0.0), 0.85, (0.9, 0.7, 0.35), 0.3, leather),
        ball((0.75, 0.25, 0.38), 0.38, steel),
        ball((-0.75, -0.25, 0.38), 0.38, steel),
        rod((-1.0, 0.4, 0.15), (-0.2, 1.0, 0.15), 0.15, enamel),
        post((1.3, -1.0), 1.5, 0.1, enamel),
        post((-1.4, 1.2), 1.1, 0.22, grained((0.3, 0.5, 0.25), 0.8, (0.1, 0.1), 46)),
        box((0.2, ROOM - 0.05), 1.0, (1.4, 0.06, 1.0), 0.0, poster),
        box((ROOM - 0.05, -1.0), 1.1, (0.06, 1.0, 0.8), 0.0, chart),
    ]


# --- grove -------------------------------------------------------------------------------------


def grass_and_leaves(_: float) -> list[Primitive]:
    leaves = grained((0.5, 0.44, 0.26), 1.4, (0.25, 0.25), 50)
    grass = Grained(leaves, 1.0, (0.05, 0.05), 52)
    return walled((-GROVE, -GROVE, 0.0), (2 * GROVE, 2 * GROVE, 0.0), [grass])


def trees() -> list[Primitive]:
    """An old tree in the middle with branches, and others behind the cameras."""
    furrows = Stripes((0.42, 0.35, 0.28), (0.26, 0.21, 0.17), 0.06, np.pi / 2)
    bark = Grained(furrows, 1.2, (0.06, 0.3), 54)
    foliage = grained((0.3, 0.42, 0.16), 1.6, (0.09, 0.09), 56)
    things: list[Primitive] = [post((0.0, 0.0), 3.6, 0.5, bark)]
    for turn in range(6):
        out = turn_z(turn * np.pi / 3) @ np.array([1.0, 0.0, 0.0])
        tip, far = np.array([0.0, 0.0, 2.3 + 0.1 * turn]), 9.0 * (turn_z(0.3) @ out)
        root = 0.75 * (turn_z(0.5) @ out) + np.array([0.0, 0.0, 0.05])
        things += [
            rod((0.0, 0.0, 1.4 + 0.25 * turn), 1.5 * out + tip, 0.12, bark),
            ball(1.6 * out + tip, 0.55, foliage),
            rod((0.0, 0.0, 0.3), root, 0.14, bark),
            post(far[:2], 4.5, 0.35, bark),
            ball(far + np.array([0.0, 0.0, 3.2]), 1.6, foliage),
        ]
    return things


# --- facade ------------------------------------------------------------------------------------


def lawn_and_paths(_: float) -> list[Primitive]:
    """Short grass, which hardly has a structure from so far, and gravel paths to the door."""
    grass = grained((0.36, 0.52, 0.22), 0.08, (4.0, 4.0), 60)
    gravel = grained((0.8, 0.76, 0.68), 0.05, (2.0, 2.0), 62)
    return [
        *walled((-LAWN, -LAWN, 0.0), (2 * LAWN, 2 * LAWN, 0.0), [grass]),
        rect((-1.6, -LAWN, 0.01), (3.2, 0, 0), (0, LAWN, 0), gravel),
        rect((-12.0, -4.0, 0.01), (24.0, 0, 0), (0, 2.2, 0), gravel),
    ]


def _window(
    x: float, y: float, bottom: float, size: tuple[float, float], seed: int
) -> list[Primitive]:
    """Panes between white bars, a frame and a sill; `y` is that of the wall."""
    width, height = size
    panes = Bricks((0.3, 0.34, 0.4), (0.9, 0.88, 0.83), (0.42, 0.5), 0.07, 0.6, 0.0, seed)
    stone = grained((0.92, 0.88, 0.78), 0.2, (0.2, 0.2), 64)
    return [
        rect((x - width / 2, y - 0.02, bottom), (width, 0, 0), (0, 0, height), panes),
        box((x, y - 0.08), bottom - 0.14, (width + 0.3, 0.3, 0.14), 0.0, stone),
        box((x, y - 0.05), bottom + height, (width + 0.3, 0.2, 0.16), 0.0, stone),
        *(
            box((x + s, y - 0.05), bottom, (0.14, 0.2, height), 0.0, stone)
            for s in (-width / 2 - 0.07, width / 2 + 0.07)
        ),
    ]


def _roof(left: float, width: float, front: float, eaves: float, ridge: float) -> Primitive:
    """The slope of slates that one sees from the lawn."""
    bare = Bricks((0.42, 0.46, 0.54), (0.3, 0.33, 0.4), (0.5, 0.3), 0.03, 0.4, seed=66)
    slates = Grained(bare, 0.4, (0.8, 0.8), 68)
    return rect((left, front - 0.2, eaves), (width, 0, 0), (0.0, 1.6, ridge - eaves), slates)


def _house() -> list[Primitive]:
    ashlar = Bricks((0.88, 0.8, 0.64), (0.72, 0.65, 0.52), (0.9, 0.4), 0.04, 0.25, seed=70)
    wall = Grained(ashlar, 0.35, (0.7, 0.5), 72)
    bricks = Bricks((0.72, 0.42, 0.32), (0.7, 0.62, 0.55), (0.4, 0.2), 0.03, seed=74)
    brick = Grained(bricks, 0.3, (0.5, 0.4), 76)
    stone = grained((0.93, 0.89, 0.8), 0.3, (0.3, 0.2), 78)
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
    ]
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
    bark = grained((0.36, 0.29, 0.22), 1.0, (0.1, 0.5), seed)
    leaves = grained((0.26, 0.4, 0.16), 1.5, (0.3, 0.3), seed + 2)
    top = np.array([*xy, height - crown])
    shifts = [(0, 0, 0), (0.7, 0.1, -0.4), (-0.6, 0.2, -0.3), (0.1, -0.5, -0.6)]
    balls = [ball(top + crown * np.array(shift), 0.75 * crown, leaves) for shift in shifts]
    return [post(xy, height - crown, 0.22, bark), *balls]


def house_and_trees() -> list[Primitive]:
    """The house; trees beside the lawn, where only photos from the ends of the walk show them, and
    far behind."""
    standing = [((7.3, -10.3), 5.5, 1.4), ((-7.0, -10.8), 5.0, 1.4)]
    standing += [((9.6, -5.0), 7.0, 1.8), ((-9.8, -5.5), 6.5, 1.8)]
    far = np.arange(-42.0, 43.0, 3.6).tolist()
    standing += [((x, 22.0 + (x % 3)), 7.0 + x % 2, 3.0) for x in far]
    seeded = ((*tree, 120 + 4 * (number % 8)) for number, tree in enumerate(standing))
    return [*_house(), *(part for tree in seeded for part in _tree(*tree))]


# --- table: three times as large as life, so that cameras and occluders of the yard fit ----------


def room_behind(_: float) -> list[Primitive]:
    """Bare walls and floor, a window, a door, a shelf and chairs."""
    floor = grained((0.6, 0.52, 0.44), 0.1, (6.0, 6.0), 130)
    white, oak = Plain((0.93, 0.93, 0.9)), grained((0.55, 0.4, 0.26), 0.2, (2.0, 2.0), 134)
    panes = Bricks((0.97, 0.98, 1.0), (0.8, 0.78, 0.74), (1.7, 2.2), 0.18, 0.06, 0.0, 136)
    books = Bricks((0.75, 0.5, 0.4), (0.25, 0.18, 0.14), (0.3, 1.5), 0.05, 0.9, 0.3, 138)
    curtain = Stripes((0.62, 0.66, 0.72), (0.56, 0.6, 0.67), 0.6, np.pi / 2)
    edge = TABLE_ROOM - 0.05
    chairs = [(1.5, 8.5, 1.4), (-8.0, 6.5, 2.4), (8.5, 4.0, 0.5), (-9.0, -2.5, 3.4)]
    return [
        *bare_room(TABLE_ROOM, FLOOR, 9.0, (1.0, 0.94, 1.04, 0.97), floor),
        box((-1.0, edge), 0.4, (5.1, 0.06, 4.4), 0.0, panes),
        box((-4.6, edge - 0.1), FLOOR + 0.3, (1.8, 0.2, 7.5), 0.0, curtain),
        box((2.6, edge - 0.1), FLOOR + 0.3, (1.8, 0.2, 7.5), 0.0, curtain),
        box((-edge + 0.4, 3.0), FLOOR, (0.8, 4.0, 5.0), 0.0, books),
        box((-edge + 0.5, -5.0), FLOOR, (1.0, 3.0, 2.4), 0.0, oak),
        box((edge, 2.0), FLOOR, (0.08, 2.8, 6.0), 0.0, oak),
        box((edge - 0.5, -5.5), FLOOR, (1.0, 3.6, 2.6), 0.0, white),
        box((9.5, 11.0), FLOOR, (2.4, 1.6, 3.0), 0.2, oak),
        post((7.5, -11.0), 2.2, 0.5, Plain((0.3, 0.42, 0.3))),
        *(part for x, y, angle in chairs for part in _chair(np.array([x, y]), angle)),
    ]


def _chair(xy: np.ndarray, angle: float) -> list[Primitive]:
    """A seat, a back and legs; the back is away from the table where `angle` is its azimuth."""
    wood, turn = grained((0.5, 0.32, 0.2), 0.15, (1.5, 1.5), 132), turn_z(angle)
    back = xy + (turn @ np.array([0.6, 0.0, 0.0]))[:2]
    parts: list[Primitive] = [
        box(xy, FLOOR + 1.4, (1.3, 1.3, 0.15), angle, wood),
        box(back, FLOOR + 1.55, (0.12, 1.3, 1.4), angle, wood),
    ]
    for s, t in ((-0.55, -0.55), (-0.55, 0.55), (0.55, -0.55), (0.55, 0.55)):
        foot = np.array([*(xy + (turn @ np.array([s, t, 0.0]))[:2]), FLOOR])
        parts.append(rod(foot, foot + np.array([0.0, 0.0, 1.4]), 0.08, wood))
    return parts


def table_and_toy() -> list[Primitive]:
    """The table with its cloth, a toy digger and what else stands there."""
    walnut = Grained(Stripes((0.58, 0.38, 0.24), (0.52, 0.33, 0.2), 0.35), 0.5, (0.8, 0.08), 140)
    cloth = Grained(Checker((0.85, 0.25, 0.22), (0.93, 0.9, 0.84), 0.22), 0.3, (0.15, 0.15), 142)
    yellow = grained((0.95, 0.75, 0.15), 0.35, (0.2, 0.12), 144)
    tracks = Bricks((0.25, 0.25, 0.26), (0.08, 0.08, 0.08), (0.16, 0.3), 0.05, 0.5, seed=146)
    cab = Checker((0.2, 0.3, 0.42), (0.9, 0.72, 0.2), 0.17)
    spots = Dots((0.95, 0.95, 0.9), (0.2, 0.35, 0.6), 0.2)
    rings = Stripes((0.25, 0.5, 0.45), (0.92, 0.88, 0.75), 0.12)
    print_ = Bricks((0.9, 0.88, 0.8), (0.2, 0.22, 0.3), (0.35, 0.12), 0.03, 0.5, seed=148)
    apple = grained((0.7, 0.2, 0.12), 0.9, (0.15, 0.3), 150)
    pear = grained((0.6, 0.65, 0.2), 0.7, (0.12, 0.2), 152)
    straw = Grained(Stripes((0.72, 0.55, 0.3), (0.5, 0.35, 0.18), 0.06, 0.8), 0.4, (0.1, 0.1), 154)
    across, along = (turn_z(0.5) @ side for side in np.diag([2.2, 2.2, 0.0])[:2])
    parts: list[Primitive] = [
        box((0.0, 0.0), -0.18, (6.0, 4.4, 0.18), 0.0, walnut),
        rect((-0.1, -1.6, 0.005), across, along, cloth),
    ]
    for x, y in ((-2.7, -1.9), (-2.7, 1.9), (2.7, -1.9), (2.7, 1.9)):
        parts.append(box((x, y), FLOOR, (0.25, 0.25, -FLOOR - 0.18), 0.0, walnut))
    digger = turn_z(0.3)
    for side in (-0.42, 0.42):
        track = (digger @ np.array([0.0, side, 0.0]))[:2] + np.array([-0.3, 0.3])
        parts.append(box(track, 0.0, (1.7, 0.3, 0.38), 0.3, tracks))
    shovel = np.array([-0.3, 0.3, 0.0]) + digger @ np.array([1.15, 0.0, 0.0])
    elbow = np.array([-0.3, 0.3, 1.35]) + digger @ np.array([0.75, 0.0, 0.0])
    return [
        *parts,
        box((-0.3, 0.3), 0.38, (1.4, 0.8, 0.35), 0.3, yellow),
        box((-0.6, 0.2), 0.73, (0.6, 0.65, 0.55), 0.3, cab),
        rod((-0.1, 0.35, 0.75), elbow, 0.09, yellow),
        rod(elbow, [*shovel[:2], 0.4], 0.08, yellow),
        box(shovel[:2], 0.05, (0.35, 0.75, 0.4), 0.3, tracks),
        post((1.7, 0.9), 0.75, 0.3, rings),
        ball((-1.8, -0.7, 0.33), 0.33, apple),
        ball((-1.35, -1.15, 0.29), 0.29, pear),
        box((-1.9, 1.2), 0.0, (1.1, 0.8, 0.22), -0.4, print_),
        box((-1.85, 1.15), 0.22, (0.9, 0.65, 0.18), -0.1, straw),
        ball((0.9, -0.9, 0.24), 0.24, spots),
        box((0.3, 1.5), 0.0, (0.7, 0.4, 0.9), 0.2, spots),
    ]


# --- all ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Place:
    """One kind of static scene."""

    things: Callable[[], list[Primitive]]
    """What casts shadows."""
    around: Callable[[float], list[Primitive]]
    """What is around it, by the height of walls where the spec decides that."""
    stand: Stand = IN_THE_YARD
    bare: float | None = None
    """See `points.sample_pixels`."""


PLACES = {
    "yard": Place(furniture, walls_and_ground, bare=BARE),
    "room": Place(glossy_things, walls_and_floor, bare=BARE_INDOORS),
    "grove": Place(trees, grass_and_leaves, bare=BARE),
    "facade": Place(
        house_and_trees,
        lawn_and_paths,
        Stand(distance=20.0, sway=0.8, height=(1.5, 1.9), target=(0.0, 0.0, 2.3), aim=0.3),
    ),
    "table": Place(
        table_and_toy, room_behind, Stand(sway=0.5, height=(1.6, 2.5), target=(0.0, 0.0, 0.55))
    ),
}
