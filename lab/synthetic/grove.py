"""A static scene that is hard to learn: bark, leaves and grass as fine as a pixel, all around."""

from __future__ import annotations

import numpy as np

from lab.synthetic.primitives import Capsule, Primitive, Rect, Sphere
from lab.synthetic.textures import Grained, Plain, Stripes
from lab.synthetic.yard import post, turn_z

HALF = 12.0
"""The ground reaches from -HALF to HALF along x and y, metres."""


def ground() -> list[Primitive]:
    """Grass and leaves; the sky is all around."""
    corner, side = np.array([-HALF, -HALF, 0.0]), 2 * HALF
    leaves = Grained(Plain((0.5, 0.44, 0.26)), 1.4, (0.25, 0.25), 50)
    grass = Grained(leaves, 1.0, (0.05, 0.05), 52)
    return [Rect(corner, np.array([side, 0.0, 0.0]), np.array([0.0, side, 0.0]), grass)]


def trees() -> list[Primitive]:
    """An old tree in the middle with branches, and others behind the cameras."""
    furrows = Stripes((0.42, 0.35, 0.28), (0.26, 0.21, 0.17), 0.06, np.pi / 2)
    bark = Grained(furrows, 1.2, (0.06, 0.3), 54)
    foliage = Grained(Plain((0.3, 0.42, 0.16)), 1.6, (0.09, 0.09), 56)
    things: list[Primitive] = [post((0.0, 0.0), 3.6, 0.5, bark)]
    for turn in range(6):
        out = turn_z(turn * np.pi / 3) @ np.array([1.0, 0.0, 0.0])
        fork, tip = np.array([0.0, 0.0, 1.4 + 0.25 * turn]), np.array([0.0, 0.0, 2.3 + 0.1 * turn])
        things.append(Capsule(fork, 1.5 * out + tip, 0.12, bark))
        things.append(Sphere(1.6 * out + tip, 0.55, foliage))
        root = 0.75 * (turn_z(0.5) @ out) + np.array([0.0, 0.0, 0.05])
        things.append(Capsule(np.array([0.0, 0.0, 0.3]), root, 0.14, bark))
        far = 9.0 * (turn_z(0.3) @ out)
        things.append(post((far[0], far[1]), 4.5, 0.35, bark))
        things.append(Sphere(far + np.array([0.0, 0.0, 3.2]), 1.6, foliage))
    return things
