"""Left half to the embedding, right half to the figures, and nothing else moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.config import EvaluationConfig, chosen_protocol
from desplat_ns.evaluation.halves import RightHalf, RightHalfByLeft
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.halves import (
    embedding_from_left_half,
    fit_embedding,
    left_half,
    right_half,
)
from desplat_ns.training.losses import photometric_loss
from tests.helpers.lit_model import model_with, moved
from tests.helpers.small_model import HEIGHT, WIDTH

SHORT = EvaluationConfig(steps=6, learning_rate=0.05)
SHORT_FIT = SHORT.steps, SHORT.learning_rate


@pytest.fixture(scope="module")
def model() -> DeSplatModel:
    return moved(model_with("affine", background=True)).eval()


def held_out(width: int = WIDTH) -> Cameras:
    pose = torch.eye(4)[:3]
    pose[2, 3] = 3.0
    return Cameras(pose[None], 20.0, 20.0, WIDTH / 2, HEIGHT / 2, width, HEIGHT)


def photo_in_the_light_of(model: DeSplatModel, view: int, width: int = WIDTH) -> torch.Tensor:
    assert model.image_effects is not None
    with model.shown_light.fixed(model.image_effects.embeddings.of(view)):
        return model.get_outputs_for_camera(held_out(width))["rgb"]


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
    fitted = [
        embedding_from_left_half(model, held_out(width), p, *SHORT_FIT) for p in (photo, other)
    ]
    assert torch.equal(*fitted)
    left_half(other)[0, -1] += 0.5  # the last column of the left half does reach it
    assert not torch.equal(
        embedding_from_left_half(model, held_out(width), other, *SHORT_FIT), fitted[0]
    )


def test_what_is_fitted_is_what_is_scored(model):
    view = model.view_of_camera(held_out(), None)
    with torch.no_grad():
        image = model.as_function_of_embedding(view)(model.image_effects.embeddings.of(1))
    assert torch.equal(image, photo_in_the_light_of(model, 1))


def test_all_else_stays_bit_identical(model):
    before = {
        name: value.clone() for name, value in model.state_dict().items() if torch.is_tensor(value)
    }
    protocol = RightHalfByLeft(model, SHORT)
    protocol.score(held_out(), {"image": torch.rand(HEIGHT, WIDTH, 3)}, "a")
    after = model.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before.items())
    assert all(p.grad is None for p in model.parameters())
    assert not model.training


def test_the_light_of_a_photo_is_found_again(model):
    photo = photo_in_the_light_of(model, 2)
    config = EvaluationConfig(steps=128, learning_rate=0.05)
    scored, _ = RightHalfByLeft(model, config).score(held_out(), {"image": photo}, "a")
    assert scored.metrics["psnr"] > scored.metrics["psnr_before"] + 6


def test_images_do_not_influence_each_other(model):
    photos = [photo_in_the_light_of(model, view) for view in (0, 2)]
    together, alone = RightHalfByLeft(model, SHORT), RightHalfByLeft(model, SHORT)
    together.score(held_out(), {"image": photos[0]}, "first")
    together.score(held_out(), {"image": photos[1]}, "second")
    alone.score(held_out(), {"image": photos[1]}, "second")
    assert torch.equal(together.embeddings["second"], alone.embeddings["second"])


def test_figures_are_the_right_halfs(model):
    """A photo that is right on the left and wrong on the right scores as wrong."""
    assert model.image_effects is not None
    photo = photo_in_the_light_of(model, 1)
    mean = model.image_effects.embeddings.mean()
    loaded = EvaluationConfig(load_embeddings=Path("e.npz"))
    protocol = RightHalfByLeft(model, loaded, {"a": model.image_effects.embeddings.of(1).detach()})
    right, _ = protocol.score(held_out(), {"image": photo}, "a")
    assert right.metrics["psnr"] == pytest.approx(100)
    left_half(photo)[:] = 0
    same, _ = protocol.score(held_out(), {"image": photo}, "a")
    assert same.metrics["psnr"] == right.metrics["psnr"]
    right_half(photo)[:] = 0
    wrong, _ = protocol.score(held_out(), {"image": photo}, "a")
    assert wrong.metrics["psnr"] < 30
    assert torch.equal(mean, model.image_effects.embeddings.mean())


def test_a_fit_is_adam_on_the_loss_alone():
    target = torch.tensor([1.0, -2.0])
    reference = torch.zeros(2, requires_grad=True)
    optimizer = torch.optim.Adam([reference], lr=0.1)
    for _ in range(20):
        optimizer.zero_grad()
        (reference - target).square().sum().backward()
        optimizer.step()
    fitted = fit_embedding(lambda e: (e - target).square().sum(), torch.zeros(2), 20, 0.1)
    assert torch.equal(fitted, reference.detach())


def test_the_loss_is_the_photometric_one():
    image, photo = torch.rand(16, 16, 3), torch.rand(16, 16, 3)
    from pytorch_msssim import ssim

    planes = [x.permute(2, 0, 1)[None] for x in (image, photo)]
    expected = 0.8 * (image - photo).abs().mean() + 0.2 * (1 - ssim(*planes, data_range=1.0))
    torch.testing.assert_close(photometric_loss(image, photo, 0.2), expected)


@pytest.mark.parametrize(
    ("asked", "appearance", "holds"),
    [
        ("auto", "affine", "half"),
        ("auto", "off", "full"),
        ("full", "sh", "full"),
        ("half", "sh", "half"),
        ("right", "off", "right"),
        ("right", "affine", "right"),
    ],
)
def test_which_protocol_holds(asked, appearance, holds):
    assert chosen_protocol(EvaluationConfig(protocol=asked), appearance) == holds


def test_right_halves_without_embeddings_are_scored_in_the_average_light(model):
    photo = photo_in_the_light_of(model, 1)
    scored, pictures = RightHalf(model).score(held_out(), {"image": photo}, "a")
    both, _ = RightHalfByLeft(model, SHORT).score(held_out(), {"image": photo}, "a")
    assert scored.metrics["psnr"] == both.metrics["psnr_before"]
    assert "psnr_before" not in scored.metrics
    assert pictures["img"].shape == (HEIGHT, 2 * WIDTH, 3)
    left_half(photo)[:] = 0.0
    again, _ = RightHalf(model).score(held_out(), {"image": photo}, "a")
    assert again.metrics == scored.metrics


def test_halves_without_appearance_are_refused():
    with pytest.raises(ConfigError, match="appearance is off"):
        chosen_protocol(EvaluationConfig(protocol="half"), "off")


@pytest.mark.parametrize("values", [{"steps": -1}, {"learning_rate": 0.0}])
def test_steps_and_rate_have_a_range(values: dict[str, Any]):
    with pytest.raises(ConfigError, match="found"):
        chosen_protocol(EvaluationConfig(**values), "affine")


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_photo_without_halves_is_refused(model, width):
    with pytest.raises(CaptureError, match=f"{width} pixels wide"):
        embedding_from_left_half(model, held_out(width), torch.rand(HEIGHT, width, 3), *SHORT_FIT)


def test_the_narrowest_photo_is_scored(model):
    batch = {"image": torch.rand(HEIGHT, 4, 3)}
    scored, _ = RightHalfByLeft(model, SHORT).score(held_out(4), batch, "a")
    assert scored.metrics["psnr"] > 0


def test_what_a_mask_leaves_out_does_not_reach_the_embedding(model):
    photo, mask = torch.rand(HEIGHT, WIDTH, 3), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :5] = False
    other = torch.where(mask, photo, 1 - photo)
    fits = [
        embedding_from_left_half(model, held_out(), p, *SHORT_FIT, mask) for p in (photo, other)
    ]
    assert torch.equal(*fits)


def test_files_of_embeddings_need_halves():
    with pytest.raises(ConfigError, match=r"e\.npz"):
        chosen_protocol(EvaluationConfig("full", save_embeddings=Path("e.npz")), "affine")


def test_an_image_without_a_loaded_embedding_is_named(model):
    protocol = RightHalfByLeft(model, EvaluationConfig(load_embeddings=Path("e.npz")), {})
    with pytest.raises(ConfigError, match="no embedding of 'a'"):
        protocol.score(held_out(), {"image": torch.rand(HEIGHT, WIDTH, 3)}, "a")
