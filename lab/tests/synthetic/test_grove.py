from __future__ import annotations

from dataclasses import replace

import numpy as np

from lab.synthetic import SceneSpec, make_scene
from lab.synthetic.grove import HALF, ground, trees


def fineness(image: np.ndarray) -> float:
    """Share of the picture's contrast that lies between neighbouring pixels."""
    grey = image.astype(float).mean(axis=2)
    return float(np.abs(np.diff(grey, axis=1)).mean() / grey.std())


def test_trees_stand_on_the_ground_and_the_ground_faces_up():
    (grass,) = ground()
    center, _ = grass.bounds()
    normals, _ = grass.surface(center[:, None])
    assert normals[2, 0] == 1
    for thing in trees():
        center, radius = thing.bounds()
        assert np.abs(center[:2]).max() < HALF
        assert center[2] + radius > 0


def test_a_grove_is_finer_than_a_room_and_shows_the_sky():
    spec = replace(
        SceneSpec.fine_grove(6), num_extras=2, width=64, height=48, supersample=1, num_points=200
    )
    grove, room = make_scene(spec), make_scene(replace(spec, place="room"))
    fine, bare = (np.mean([fineness(f.image) for f in s.clean]) for s in (grove, room))
    assert fine > 1.5 * bare
    assert 0.05 < np.mean([np.isinf(f.depth).mean() for f in grove.clean]) < 0.6
    assert grove.points.xyz.shape[1] > 20
