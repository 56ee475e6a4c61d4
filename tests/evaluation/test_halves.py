"""Left half to the embedding, right half to the figures, and nothing else moves; right halves
are scored, in a light found on the left ones or in the average."""

import pytest
import torch

from desplat_ns.core.errors import ConfigError
from desplat_ns.evaluation import evaluate as module
from desplat_ns.evaluation import halves
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.evaluate import Scorer
from desplat_ns.evaluation.halves import (
    as_function_of_embedding,
    embedding_from_left_half,
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


def left_half(image: torch.Tensor) -> torch.Tensor:
    return image[:, : image.shape[1] // 2]


REDUCED = 60
"""Pixels of which a light is found; the photos of these tests have eight times as many."""


@pytest.mark.parametrize("pixels", [halves.FITTED_PIXELS, REDUCED])
@pytest.mark.parametrize("width", [WIDTH, WIDTH + 1])
def test_the_right_half_cannot_reach_the_embedding(model, width, pixels, monkeypatch):
    monkeypatch.setattr(halves, "FITTED_PIXELS", pixels)
    photo = torch.rand(HEIGHT, width, 3)
    other = photo.clone()
    right_half(other)[:] = torch.rand_like(right_half(other))
    fitted = [embedding_from_left_half(model, held_out(width), p, SHORT) for p in (photo, other)]
    assert torch.equal(*fitted)
    last = -1 if pixels > REDUCED else -4  # the last columns that are whole in what is drawn
    left_half(other)[0, last] += 0.5
    again = embedding_from_left_half(model, held_out(width), other, SHORT)
    assert not torch.equal(again, fitted[0])


def test_what_is_fitted_is_what_is_scored(model):
    view = model.view_of_camera(held_out(), None)
    with torch.no_grad():
        image = as_function_of_embedding(model, view, WIDTH)(model.image_effects.of(1))
    torch.testing.assert_close(image, photo_in_the_light_of(model, 1), atol=1e-6, rtol=0)


def test_what_a_mask_leaves_out_does_not_reach_the_embedding(model):
    photo, mask = torch.rand(HEIGHT, WIDTH, 3), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :5] = False
    other = torch.where(mask, photo, 1 - photo)
    fits = [embedding_from_left_half(model, held_out(), p, SHORT, mask) for p in (photo, other)]
    assert torch.equal(*fits)


def test_all_else_stays_bit_identical(model):
    before = {
        name: value.clone() for name, value in model.state_dict().items() if torch.is_tensor(value)
    }
    protocol = Scorer(model, "right half", SHORT)
    protocol.score(held_out(), {"image": torch.rand(HEIGHT, WIDTH, 3)})
    after = model.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before.items())
    assert all(p.grad is None for p in model.parameters())
    assert not model.training


@pytest.mark.slow
@pytest.mark.parametrize("pixels", [halves.FITTED_PIXELS, 2 * REDUCED])
def test_the_light_of_a_photo_is_found_again(model, pixels, monkeypatch):
    monkeypatch.setattr(halves, "FITTED_PIXELS", pixels)
    photo = photo_in_the_light_of(model, 2)
    config = EvaluationConfig(steps=128, learning_rate=0.05)
    scored, _ = Scorer(model, "right half", config).score(held_out(), {"image": photo})
    assert scored["psnr"] > scored["psnr_before"] + 6


def test_figures_are_the_right_halfs(model, monkeypatch):
    """A photo that is right on the left and wrong on the right scores as wrong."""
    photo = photo_in_the_light_of(model, 1)
    mean = model.image_effects.of(None)
    protocol, known = Scorer(model, "right half", SHORT), model.image_effects.of(1).detach()
    monkeypatch.setattr(module, "embedding_from_left_half", lambda *_: known)
    right, _ = protocol.score(held_out(), {"image": photo})
    assert right["psnr"] == pytest.approx(100)
    left_half(photo)[:] = 0
    same, _ = protocol.score(held_out(), {"image": photo})
    assert same["psnr"] == right["psnr"]
    right_half(photo)[:] = 0
    wrong, _ = protocol.score(held_out(), {"image": photo})
    assert wrong["psnr"] < 30
    assert torch.equal(mean, model.image_effects.of(None))


def test_right_halves_without_embeddings_are_scored_in_the_average_light(model):
    photo = photo_in_the_light_of(model, 1)
    scored, beside = Scorer(model, "right half").score(held_out(), {"image": photo})
    both, _ = Scorer(model, "right half", SHORT).score(held_out(), {"image": photo})
    assert scored["psnr"] == both["psnr_before"]
    assert "psnr_before" not in scored
    assert beside.shape == (HEIGHT, 2 * WIDTH, 3)
    left_half(photo)[:] = 0.0
    again, _ = Scorer(model, "right half").score(held_out(), {"image": photo})
    assert again["psnr"] == scored["psnr"]


def test_which_protocol_holds(model):
    assert Scorer.of(model, SHORT).fit is SHORT
    right, full = (Scorer.of(model, EvaluationConfig(protocol=p)) for p in ("right", "full"))
    assert (right.region, right.fit) == ("right half", None)
    plain = Scorer.of(model_with("off"), EvaluationConfig())
    assert (full.region, full.fit) == (plain.region, plain.fit) == ("full image", None)
    with pytest.raises(ConfigError, match="--steps"):
        Scorer.of(model, EvaluationConfig(steps=-1))
    with pytest.raises(ConfigError, match="--learning-rate"):
        Scorer.of(model, EvaluationConfig(learning_rate=0.0))
    with pytest.raises(ConfigError, match="appearance"):
        Scorer.of(model_with("off"), EvaluationConfig(protocol="half"))
