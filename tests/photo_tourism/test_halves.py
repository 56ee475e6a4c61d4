"""Left half to the embedding, right half to the figures, and nothing else moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from desplat_ns.evaluation.config import EvaluationConfig, uses_halves
from nerfstudio.cameras.cameras import Cameras
from test_model import HEIGHT, WIDTH
from test_model_effects import model_with, moved

from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.halves import (
    HalvesProtocol,
    embedding_from_left_half,
    fit_embedding,
    left_half,
    photometric_loss,
    right_half,
)

SHORT = EvaluationConfig(steps=6, learning_rate=0.05)


@pytest.fixture(scope="module")
def model() -> DeSplatModel:
    return moved(model_with("affine", background=True)).eval()


def held_out(width: int = WIDTH) -> Cameras:
    pose = torch.eye(4)[:3]
    pose[2, 3] = 3.0
    return Cameras(pose[None], 20.0, 20.0, WIDTH / 2, HEIGHT / 2, width, HEIGHT)


def photo_in_the_light_of(model: DeSplatModel, view: int, width: int = WIDTH) -> torch.Tensor:
    assert model.image_effects is not None
    with model.worn.fixed(model.image_effects.embeddings.of(view)):
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
    fitted = [embedding_from_left_half(model, held_out(width), p, SHORT) for p in (photo, other)]
    assert torch.equal(*fitted)
    left_half(other)[0, -1] += 0.5  # the last column of the left half does reach it
    assert not torch.equal(
        embedding_from_left_half(model, held_out(width), other, SHORT), fitted[0]
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
    protocol = HalvesProtocol(SHORT)
    protocol.score(model, held_out(), {"image": torch.rand(HEIGHT, WIDTH, 3)}, "a")
    after = model.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before.items())
    assert all(p.grad is None for p in model.parameters())
    assert not model.training


def test_the_light_of_a_photo_is_found_again(model):
    photo = photo_in_the_light_of(model, 2)
    config = EvaluationConfig(steps=128, learning_rate=0.05)
    scored, _ = HalvesProtocol(config).score(model, held_out(), {"image": photo}, "a")
    assert scored.metrics["psnr"] > scored.metrics["psnr_before"] + 6


def test_images_do_not_influence_each_other(model):
    photos = [photo_in_the_light_of(model, view) for view in (0, 2)]
    together, alone = HalvesProtocol(SHORT), HalvesProtocol(SHORT)
    together.score(model, held_out(), {"image": photos[0]}, "first")
    together.score(model, held_out(), {"image": photos[1]}, "second")
    alone.score(model, held_out(), {"image": photos[1]}, "second")
    assert torch.equal(together.embeddings["second"], alone.embeddings["second"])


def test_figures_are_the_right_halfs(model):
    """A photo that is right on the left and wrong on the right scores as wrong."""
    assert model.image_effects is not None
    photo = photo_in_the_light_of(model, 1)
    mean = model.image_effects.embeddings.mean()
    loaded = EvaluationConfig(load_embeddings=Path("e.npz"))
    protocol = HalvesProtocol(loaded, {"a": model.image_effects.embeddings.of(1).detach()})
    right, _ = protocol.score(model, held_out(), {"image": photo}, "a")
    assert right.metrics["psnr"] == pytest.approx(100)
    left_half(photo)[:] = 0
    same, _ = protocol.score(model, held_out(), {"image": photo}, "a")
    assert same.metrics["psnr"] == right.metrics["psnr"]
    right_half(photo)[:] = 0
    wrong, _ = protocol.score(model, held_out(), {"image": photo}, "a")
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
    ("protocol", "appearance", "halves"),
    [
        ("auto", "affine", True),
        ("auto", "off", False),
        ("full", "sh", False),
        ("half", "sh", True),
    ],
)
def test_which_protocol_holds(protocol, appearance, halves):
    assert uses_halves(EvaluationConfig(protocol=protocol), appearance) is halves


def test_halves_without_appearance_are_refused():
    with pytest.raises(ConfigError, match="appearance is off"):
        uses_halves(EvaluationConfig(protocol="half"), "off")


@pytest.mark.parametrize("values", [{"steps": -1}, {"learning_rate": 0.0}])
def test_steps_and_rate_have_a_range(values: dict[str, Any]):
    with pytest.raises(ConfigError, match="found"):
        uses_halves(EvaluationConfig(**values), "affine")


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_photo_without_halves_is_refused(model, width):
    with pytest.raises(CaptureError, match=f"{width} pixels wide"):
        embedding_from_left_half(model, held_out(width), torch.rand(HEIGHT, width, 3), SHORT)


def test_the_narrowest_photo_is_scored(model):
    batch = {"image": torch.rand(HEIGHT, 4, 3)}
    scored, _ = HalvesProtocol(SHORT).score(model, held_out(4), batch, "a")
    assert scored.metrics["psnr"] > 0


def test_what_a_mask_leaves_out_does_not_reach_the_embedding(model):
    photo, mask = torch.rand(HEIGHT, WIDTH, 3), torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :5] = False
    other = torch.where(mask, photo, 1 - photo)
    fits = [embedding_from_left_half(model, held_out(), p, SHORT, mask) for p in (photo, other)]
    assert torch.equal(*fits)


def test_files_of_embeddings_need_halves():
    with pytest.raises(ConfigError, match=r"e\.npz"):
        uses_halves(EvaluationConfig("full", save_embeddings=Path("e.npz")), "affine")


def test_an_image_without_a_loaded_embedding_is_named(model):
    protocol = HalvesProtocol(EvaluationConfig(load_embeddings=Path("e.npz")), {})
    with pytest.raises(ConfigError, match="no embedding of 'a'"):
        protocol.score(model, held_out(), {"image": torch.rand(HEIGHT, WIDTH, 3)}, "a")
