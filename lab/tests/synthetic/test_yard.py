from __future__ import annotations

import numpy as np

from lab.synthetic.primitives import Box, Capsule, Rect, Sphere
from lab.synthetic.yard import BACK, FRONT, HALF_WIDTH, furniture, walls_and_ground


def test_the_furniture_stands_inside_the_walls_and_on_the_ground():
    for thing in furniture():
        center, _ = thing.bounds()
        assert abs(center[0]) < HALF_WIDTH
        assert FRONT < center[1] < BACK
        assert center[2] > 0


def test_walls_face_the_yard():
    inside = np.array([0.0, 0.0, 1.0])
    for wall in walls_and_ground(5.0):
        assert isinstance(wall, Rect)
        center, _ = wall.bounds()
        normals, _ = wall.surface(center[:, None])
        assert normals[:, 0] @ (inside - center) > 0


def test_the_yard_holds_every_kind_of_solid():
    kinds = {type(thing) for thing in walls_and_ground(5.0) + furniture()}
    assert kinds == {Rect, Box, Sphere, Capsule}
