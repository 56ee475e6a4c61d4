"""Which views have something to say of one, and where a plane before it is seen by another."""

import numpy as np
import pytest

from desplat_ns.cameras.view_pairs import homographies, views_beside


def test_a_point_of_a_plane_goes_where_both_cameras_see_it():
    rng = np.random.default_rng(0)
    K = np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])
    turn, _ = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(3, 3)))
    other = np.eye(4)
    other[:3, :3], other[:3, 3] = turn * np.sign(np.diag(turn)), (0.2, -0.1, 0.1)
    depth = 3.0
    point = np.array([0.3, -0.4, depth, 1.0])
    to_other, is_before = homographies(K, np.eye(4), K, other, (64, 48), np.array([1 / depth, 0]))
    here, there = (K @ (pose @ point)[:3] for pose in (np.eye(4), other))
    warped = to_other[0] @ (here / here[2] - [0.5, 0.5, 0])
    np.testing.assert_allclose(warped / warped[2] + [0.5, 0.5, 0], there / there[2])
    assert is_before.all()
    behind = np.diag([-1.0, 1, -1, 1])  # it looks the other way
    assert not homographies(K, np.eye(4), K, behind, (64, 48), np.array([1 / depth]))[1].any()


@pytest.mark.parametrize("count", [90, 720])
def test_neighbours_are_about_eight_degrees_away_however_many_views_there_are(count):
    """Cameras in a ring around random points; of 720, angles are taken at some points only."""
    angles = np.arange(count) * (2 * np.pi / count)
    centers = 10 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    points = np.random.default_rng(0).normal(size=(3000, 3))
    sees_all = np.ones((count, 3000), bool)
    degrees, weights, others = views_beside(7, np.arange(count), sees_all, points, centers)
    apart = np.abs((others - 7 + count / 2) % count - count / 2) * 360 / count
    np.testing.assert_allclose(degrees, apart, atol=0.15 * apart.max())
    assert np.abs(degrees[np.argsort(-weights)[:6]] - 8).max() < 8
