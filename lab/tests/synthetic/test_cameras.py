from __future__ import annotations

import numpy as np
import pytest

from lab.synthetic.cameras import PinholeCamera, arc, look_at

K = np.array([[50.0, 0, 24], [0, 50, 16], [0, 0, 1]])


@pytest.fixture
def camera() -> PinholeCamera:
    return PinholeCamera(K, look_at(np.array([1.0, -4, 1.5]), np.array([0.0, 0, 1])), 48, 32)


def test_looking_along_y_puts_x_right_and_z_up_in_the_picture():
    camera = PinholeCamera(K, look_at(np.array([0.0, -2, 0]), np.zeros(3)), 48, 32)
    points = np.array([[0.0, 0, 0], [0.2, 0, 0], [0, 0, 0.2]]).T
    pixels, depth = camera.project(points)
    # 0.2 m at a depth of 2 m and a focal length of 50 pixels: 5 pixels.
    np.testing.assert_allclose(pixels, [[24, 29, 24], [16, 16, 11]], atol=1e-12)
    np.testing.assert_allclose(depth, 2, atol=1e-12)


def test_the_pose_is_a_rotation_and_the_camera_stands_where_it_was_put(camera):
    rotation = camera.viewmat[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(camera.position, [1, -4, 1.5], atol=1e-14)


@pytest.mark.parametrize("supersample", [1, 3])
def test_points_along_rays_project_back_to_the_samples(camera, supersample):
    rays = camera.rays(supersample)
    assert rays.shape == (3, 32 * supersample, 48 * supersample)
    points = camera.position[:, None] + 2.5 * rays.reshape(3, -1).astype(np.float64)
    (x, y), depth = camera.project(points)
    np.testing.assert_allclose(depth, 2.5, rtol=1e-6)
    columns, rows = np.meshgrid(np.arange(48 * supersample), np.arange(32 * supersample))
    # float32 rays: 1e-6 of 50 pixels, times a few operations.
    np.testing.assert_allclose(x, (columns.ravel() + 0.5) / supersample, atol=1e-4)
    np.testing.assert_allclose(y, (rows.ravel() + 0.5) / supersample, atol=1e-4)


def test_points_behind_the_camera_have_no_pixel(camera):
    pixels, depth = camera.project(np.array([[1.0], [-9], [1.5]]))
    assert depth < 0
    assert np.isnan(pixels).all()


def test_an_arc_has_one_camera_for_each_azimuth_and_all_differ():
    cameras = arc(np.linspace(-1, 1, 5), (48, 32), np.random.default_rng(0))
    positions = np.stack([camera.position for camera in cameras])
    azimuths = np.arctan2(positions[:, 0], -positions[:, 1])
    np.testing.assert_allclose(azimuths, np.linspace(-1, 1, 5), atol=1e-12)
    assert len(set(positions[:, 2])) == 5


def test_another_format_keeps_the_pose_and_the_angle_along_the_longer_side(camera):
    upright = camera.with_size(32, 48)
    np.testing.assert_array_equal(upright.viewmat, camera.viewmat)
    assert (upright.width, upright.height) == (32, 48)
    assert upright.K.tolist() == [[50, 0, 16], [0, 50, 24], [0, 0, 1]]
    smaller = camera.with_size(24, 16)
    assert smaller.K.tolist() == [[25, 0, 12], [0, 25, 8], [0, 0, 1]]
