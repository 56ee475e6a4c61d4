"""Masks lie over the photos as they are on disk."""

import numpy as np
import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.export.masks import dilated, distractor_mask
from desplat_ns.export.photos import Photo
from tests.helpers.small_model import camera, cameras, distractors_of, make_model


def with_distractors():
    """A model whose distractors cover half of the second view."""
    model = make_model().eval()
    params = distractors_of(model, 1)
    params["opacities"].data[:] = 5.0
    params["means"].data[:, 0] -= params["means"].data[:, 0].mean()
    params["scales"].data[:] -= 0.5
    return model


def test_a_mask_is_that_of_the_models_own_output():
    model = with_distractors()
    photo = Photo(1, "b.jpg", cameras()[1:2])
    mask = distractor_mask(model, photo)
    shown = model.get_outputs_for_camera(camera(1))["distractor_mask"][..., 0].numpy()
    assert np.array_equal(mask, shown)
    assert 0 < mask.mean() < 1


def test_a_mask_has_the_photos_full_size():
    model, small = with_distractors(), cameras()[1:2]
    large = Cameras(
        small.camera_to_worlds, small.fx * 4, small.fy * 4, small.cx * 4, small.cy * 4, 96, 80
    )
    mask = distractor_mask(model, Photo(1, "b.jpg", large))
    assert mask.shape == (80, 96)
    of_small = distractor_mask(model, Photo(1, "b.jpg", small))
    assert np.mean(mask[2::4, 2::4] == of_small) > 0.9


def test_a_photo_without_distractors_has_an_empty_mask():
    model = with_distractors()
    for parameter in distractors_of(model, 0).values():
        parameter.data = parameter.data[:0]
    assert not distractor_mask(model, Photo(0, "a.jpg", cameras()[:1])).any()


@pytest.mark.parametrize("pixels", [0.0, 1.0, 1.5, 3.0, 7.2])
def test_a_grown_mask_holds_what_is_no_farther_than_the_distance(pixels: float):
    mask = torch.rand(30, 40, generator=torch.Generator().manual_seed(0)).numpy() > 0.99
    rows, columns = np.mgrid[:30, :40]
    inside = np.argwhere(mask)
    squared = (rows[..., None] - inside[:, 0]) ** 2 + (columns[..., None] - inside[:, 1]) ** 2
    assert np.array_equal(dilated(mask, pixels), squared.min(-1) <= pixels**2)


def test_an_empty_mask_stays_empty():
    assert not dilated(np.zeros((5, 6), bool), 3.0).any()
