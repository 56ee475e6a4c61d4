from __future__ import annotations

import numpy as np
import pytest

from lab.synthetic.cameras import PinholeCamera, look_at
from lab.synthetic.colmap_export import RegisteredPhoto, pycolmap, write_reconstruction

K = np.array([[40.0, 0, 24], [0, 42, 16], [0, 0, 1]])


def test_pycolmap_reads_back_what_was_written(tmp_path):
    rng = np.random.default_rng(0)
    xyz, rgb = rng.uniform(-0.5, 0.5, (3, 5)), rng.integers(0, 256, (3, 5), np.uint8)
    photos = []
    for number, x in enumerate((-1.0, 1.0)):
        camera = PinholeCamera(K, look_at(np.array([x, -3, 0.5]), np.zeros(3)), 48, 32)
        ids = np.array([0, 2, 4, 1]) if number else np.array([4, 3, 0])
        photos.append(
            RegisteredPhoto(f"p{number}.png", camera, ids, camera.project(xyz[:, ids])[0])
        )
    write_reconstruction(tmp_path / "sparse" / "0", photos, xyz, rgb)

    read = pycolmap.Reconstruction(tmp_path / "sparse" / "0")
    assert (read.num_images(), read.num_points3D(), read.num_cameras()) == (2, 5, 1)
    (camera,) = read.cameras.values()
    assert camera.model.name == "PINHOLE"
    assert (camera.width, camera.height) == (48, 32)
    assert camera.params.tolist() == [40, 42, 24, 16]
    for photo in photos:
        image = read.find_image_with_name(photo.name)
        assert image is not None
        np.testing.assert_allclose(
            image.cam_from_world().matrix(), photo.camera.viewmat[:3], atol=1e-14
        )
        assert [point.point3D_id - 1 for point in image.points2D] == photo.point_ids.tolist()
    for point_id, point in read.points3D.items():
        np.testing.assert_array_equal(point.xyz, xyz[:, point_id - 1])
        np.testing.assert_array_equal(point.color, rgb[:, point_id - 1])
        assert point.error == pytest.approx(0, abs=1e-9)
        assert point.track.length() == sum(point_id - 1 in photo.point_ids for photo in photos)
