"""Left half to the embedding, right half to the figures, and nothing else moves."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.errors import CaptureError
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.halves import (
    as_function_of_embedding,
    embedding_from_left_half,
    left_half,
    right_half,
)
from desplat_ns.model import DeSplatModel
from tests.helpers.small_model import (
    HEIGHT,
    WIDTH,
    held_out,
    model_with,
    moved,
    photo_in_the_light_of,
)

SHORT = EvaluationConfig(steps=6, learning_rate=0.05)


@pytest.fixture(scope="module")
def model() -> DeSplatModel:
    return moved(model_with("affine", background="image")).eval()


@pytest.mark.parametrize("width", [2, 7, 8])
def test_halves_are_disjoint_and_cover_the_image(width):
    image = torch.arange(width).expand(3, width)[..., None].float()
    left, right = left_half(image), right_half(image)
    assert left.shape[1] == width // 2
    assert torch.equal(torch.cat([left, right], dim=1), image)


@pytest.mark.parametrize("width", [WIDTH, WIDTH + 1])
def test_the_right_half_cannot_reach_the_embedding(model, width):
    photo = torch.rand(HEIGHT, width, 3)
    other = photo.clone()
    right_half(other)[:] = torch.rand_like(right_half(other))
    fitted = [embedding_from_left_half(model, held_out(width), p, SHORT) for p in (photo, other)]
    assert torch.equal(*fitted)
    left_half(other)[0, -1] += 0.5  # the last column of the left half does reach it
    assert not torch.equal(
        embedding_from_left_half(model, held_out(width), other, SHORT), fitted[0]
    )


def test_what_is_fitted_is_what_is_scored(model):
    view = model.view_of_camera(held_out(), None)
    with torch.no_grad():
        image = as_function_of_embedding(model, view)(model.image_effects.of(1))
    torch.testing.assert_close(image, photo_in_the_light_of(model, 1), atol=1e-6, rtol=0)


@pytest.mark.parametrize("width", [1, 3])
def test_a_photo_without_halves_is_refused(model, width):
    with pytest.raises(CaptureError, match="--protocol"):
        embedding_from_left_half(model, held_out(width), torch.rand(HEIGHT, width, 3), SHORT)


def test_what_a_mask_leaves_out_does_not_reach_the_embedding(model):
    photo, mask = torch.rand(HEIGHT, WIDTH, 3), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :5] = False
    other = torch.where(mask, photo, 1 - photo)
    fits = [embedding_from_left_half(model, held_out(), p, SHORT, mask) for p in (photo, other)]
    assert torch.equal(*fits)
