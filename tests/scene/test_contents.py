"""Cameras as the page has them: its axes and its lens show points where ours do."""

import numpy as np
import pytest
import torch

from desplat_ns.rendering.views import image_points
from desplat_ns.scene.contents import TO_PAGE
from tests.helpers.scene import HEIGHT, WIDTH, camera


@pytest.mark.parametrize("degrees", [0, 40, -70, 180])
def test_a_point_of_the_page_is_seen_where_our_camera_sees_it(degrees: float):
    """OpenGL's camera looks along -z with y up: x = c_x - f_x X / Z, y = c_y + f_y Y / Z."""
    photo = camera("a.png", degrees)
    record = photo.as_json()
    points = np.random.default_rng(0).normal(size=(20, 3)) * 0.3
    pose = np.array(record["pose"]).reshape(4, 4).T
    in_page = points @ TO_PAGE.turn.T
    in_camera = (in_page - pose[:3, 3]) @ pose[:3, :3]
    fx, fy, cx, cy = record["lens"]
    assert (in_camera[:, 2] < 0).all()
    x = cx - fx * in_camera[:, 0] / in_camera[:, 2]
    y = cy + fy * in_camera[:, 1] / in_camera[:, 2]
    u, v, _ = image_points(torch.from_numpy(points), photo.view)
    assert np.allclose(x, u * WIDTH) and np.allclose(y, v * HEIGHT)


def test_the_vertical_of_training_is_the_pages():
    """nerfstudio's z is up; the page's y."""
    assert (np.array([0, 0, 1]) @ TO_PAGE.turn.T == (0, 1, 0)).all()
