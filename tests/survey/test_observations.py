"""Where points appear in a photo, and what is near them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras, CameraType

from desplat_ns.survey.observations import View, colors_of_photos

VIEW = View(
    np.eye(3),
    np.zeros(3),
    np.array([[90.0, 0.0, 48.0], [0.0, 80.0, 36.0], [0.0, 0.0, 1.0]]),
    (96, 72),
    np.zeros(6),
    False,
)
POINTS = np.random.default_rng(0).uniform([-0.4, -0.3, 1.0], [0.4, 0.3, 2.0], (20, 3))


@pytest.mark.parametrize("is_fisheye", [False, True])
def test_a_bent_lens_is_nerfstudios(is_fisheye: bool):
    """Rays through the pixels, as nerfstudio makes them, lead to the points."""
    k1, k2, k3, p1, p2 = 0.1, -0.05, 0.02, *((0.0, 0.0) if is_fisheye else (0.01, -0.02))
    bent = replace(VIEW, distortion=np.array([k1, k2, k3, 0, p1, p2]), is_fisheye=is_fisheye)
    pixels, _ = bent.project(POINTS)
    assert np.abs(pixels - VIEW.project(POINTS)[0]).max() > 0.5
    camera = Cameras(
        torch.eye(4)[None, :3],
        *torch.tensor([90.0, 80.0, 48.0, 36.0]),
        distortion_params=torch.tensor([k1, k2, k3, 0, p1, p2]),
        camera_type=CameraType.FISHEYE if is_fisheye else CameraType.PERSPECTIVE,
    )
    coords = torch.from_numpy(pixels[:, ::-1].copy()).float()
    rays = camera.generate_rays(0, coords=coords).directions.numpy() * [1, -1, -1]
    unit = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    np.testing.assert_allclose(rays, unit, atol=1e-4)


def test_points_take_the_colours_of_the_photos_at_them(still):
    """Half of the points within a tenth of the colour that the scene has there: the others lie at
    edges of small photos. A point that no photo shows is like its neighbour, or grey if there is
    none."""
    found = colors_of_photos(still).astype(float)
    truth = still.metadata["points3D_rgb"].numpy().astype(float)
    off = np.abs(found - truth).max(axis=1)
    assert np.median(off) < 25 and np.median(np.abs(truth - truth.mean(0))) > 25
    xyz = still.metadata["points3D_xyz"]
    behind = torch.cat([xyz, xyz.mean(0) + 1e4 * torch.ones(1, 3)])
    with_one = replace(still, metadata={"points3D_xyz": behind})
    nearest = (xyz - behind[-1]).norm(dim=1).argmin()
    assert (colors_of_photos(with_one)[-1] == found[nearest]).all()
    above = still.cameras.camera_to_worlds[:, :, 3].mean(0) + torch.tensor([[0, 0, 1e4]])
    nowhere = replace(still, metadata={"points3D_xyz": above})
    assert colors_of_photos(nowhere).tolist() == [[128] * 3]


def test_directions_lead_to_the_points():
    pixels, _ = VIEW.project(POINTS)
    unit = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    np.testing.assert_allclose(VIEW.directions(pixels), unit, atol=1e-12)


def test_the_mean_is_that_of_the_others_in_three_by_three_cells():
    places = np.array([[1.0, 1.0], [3.0, 1.0], [5.9, 1.0], [6.1, 1.0], [90.0, 60.0]])
    mean, count = VIEW.near_means(places, np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    # Cells are 2 pixels wide: columns 0, 1, 2, 3 and one far away.
    np.testing.assert_allclose(count, [1, 2, 2, 1, 0])
    np.testing.assert_allclose(mean, [2, 2, 3, 3, 0])
