from __future__ import annotations

import numpy as np

from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.points import lift, sample_pixels, sample_points, sees
from lab.synthetic.primitives import Rect
from lab.synthetic.render import draw, sky
from lab.synthetic.textures import Plain

GREY = Plain((0.5, 0.5, 0.5))
K = np.array([[40.0, 0, 24], [0, 40, 16], [0, 0, 1]])


def view(x: float) -> tuple[PinholeCamera, np.ndarray, np.ndarray]:
    """A camera before a wall in the plane y = 0."""
    camera = PinholeCamera(K, look_at(np.array([x, -3, 0]), np.array([x, 0.0, 0])), 48, 32)
    wall = Rect(np.array([-9.0, 0, -9]), np.array([18.0, 0, 0]), np.array([0.0, 0, 18]), GREY)
    depth = draw([wall], camera, 1, sky(camera, 1)).depth
    return camera, np.full((32, 48, 3), 200, np.uint8), depth


def test_lifted_pixels_project_to_their_centres():
    camera, _, depth = view(0.3)
    rows, columns = np.array([3, 30]), np.array([40, 7])
    points = lift(camera, rows, columns, depth[rows, columns])
    np.testing.assert_allclose(points[1], 0, atol=1e-5)
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(pixels, [columns + 0.5, rows + 0.5], atol=1e-9)


def test_a_point_before_or_behind_the_surface_is_not_seen():
    camera, _, depth = view(0.0)
    points = np.array([[0.0, 0, 0, 0, 5], [0.0, -0.3, 0.3, -9, 0], [0.1] * 5])
    assert sees(camera, depth, points)[0].tolist() == [True, False, False, False, False]


def test_structure_attracts_points():
    image = np.full((32, 48, 3), 90, np.uint8)
    image[:, 22:26] = 250
    _, columns = sample_pixels(image, 2000, np.random.default_rng(0))
    # Weight 82 on the 4 columns beside the two edges, 2 on the 44 others: 0.79 of all.
    assert ((columns >= 20) & (columns < 28)).mean() > 0.75


def test_points_have_tracks_of_three_views_and_lie_where_they_are_seen():
    views = [view(x) for x in (-1.2, -0.4, 0.4, 1.2)]
    cloud = sample_points(views, 200, np.random.default_rng(0))
    assert 0 < cloud.xyz.shape[1] <= 200
    assert (cloud.rgb == 200).all()
    np.testing.assert_allclose(cloud.xyz[1], 0, atol=1e-5)
    assert (cloud.is_seen.sum(axis=0) >= 3).all()
    assert not cloud.is_seen.all()
    for i, (camera, *_) in enumerate(views):
        (x, y), _ = camera.project(cloud.xyz)
        inside = (x >= 0) & (x < 48) & (y >= 0) & (y < 32)
        np.testing.assert_array_equal(cloud.is_seen[i], inside)
        np.testing.assert_array_equal(cloud.columns[i], np.where(inside, x, 0).astype(int))


def test_a_mask_hides_the_points_under_it_that_the_view_shows():
    cloud = sample_points([view(x) for x in (-0.8, 0.0, 0.8)], 100, np.random.default_rng(0))
    mask = np.zeros((32, 48), bool)
    mask[:, :24] = True
    hidden = cloud.hidden_by(0, mask)
    np.testing.assert_array_equal(hidden, cloud.is_seen[0] & (cloud.columns[0] < 24))
    assert 0 < hidden.sum() < len(hidden)
    kept = cloud.keep(np.flatnonzero(hidden))
    assert kept.hidden_by(0, mask).all()


def test_the_sky_gives_no_points():
    camera, image, depth = view(0.0)
    endless = np.full_like(depth, np.inf)
    cloud = sample_points([(camera, image, endless)] * 4, 50, np.random.default_rng(0))
    assert cloud.xyz.shape == (3, 0)
