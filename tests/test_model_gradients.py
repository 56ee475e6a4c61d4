"""Which gradient reaches what: the background, the pose, and pixels that the user masked."""

from __future__ import annotations

import pytest
import torch
from nerfstudio.cameras.camera_optimizers import CameraOptimizerConfig

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.settings.effects import EffectsConfig
from tests.helpers.small_model import (
    HEIGHT,
    WIDTH,
    Trainer,
    camera,
    distractors_of,
    make_model,
)

EVERYWHERE = DistractorConfig(per_view=20, static_alone=True)
TOGETHER = DistractorConfig(per_view=20)


def with_background(distractors: DistractorConfig) -> DeSplatModel:
    return make_model(effects=EffectsConfig(background="image"), distractors=distractors)


def reaches_the_background(model: DeSplatModel, name: str) -> bool:
    """Whether the term `name` of the loss of training view 0 moves the background."""
    trainer = Trainer(model)
    model.train()
    model.optimizers = trainer.optimizers
    losses = model.get_loss_dict(model(camera(0)), {"image": trainer.photo})
    assert model.image_effects.background is not None
    parameters = list(model.image_effects.background.parameters())
    gradients = torch.autograd.grad(losses[name], parameters, allow_unused=True)
    return any(gradient is not None and bool(gradient.any()) for gradient in gradients)


def test_alone_the_static_scene_has_the_background_to_itself():
    """As its Gaussians do, the background learns from the static scene's own loss only."""
    model = with_background(EVERYWHERE)
    assert not reaches_the_background(model, "main_loss")
    assert reaches_the_background(model, "static_photometric")
    assert reaches_the_background(with_background(TOGETHER), "main_loss")


@pytest.mark.slow
def test_a_pose_that_is_off_is_put_right_by_its_own_photo():
    """The photo was taken 0.1 beside where the capture says; only the pose may move."""
    options = {"camera_optimizer": CameraOptimizerConfig(mode="SO3xR3"), "backend": "numba"}
    model = make_model(effects=EffectsConfig(distractors=False), **options)
    adjustment = model.camera_optimizer.pose_adjustment
    adjustment.data[1, 0] = 0.1
    trainer = Trainer(model)
    trainer.photo = model.eval().get_outputs_for_camera(camera(1))["rgb"]
    adjustment.data.zero_()
    trainer.optimizers = {"camera_opt": torch.optim.Adam([adjustment], lr=5e-3)}
    model.strategy.refine_stop_iter = 0
    losses = [trainer.step(step, view=1)["losses"]["main_loss"].item() for step in range(60)]
    assert losses[-1] < 0.2 * losses[0]
    assert not adjustment[[0, 2]].any()


@pytest.mark.parametrize("distractors", [EVERYWHERE, TOGETHER])
def test_distractors_pull_on_no_pose_and_the_static_scene_does(distractors):
    """They hang right before the camera: in the composite, all of it would fit them."""
    model = make_model(
        camera_optimizer=CameraOptimizerConfig(mode="SO3xR3"), distractors=distractors
    )
    trainer = Trainer(model)
    model.train()
    model.optimizers = trainer.optimizers
    outputs = model(camera(1))
    pose = [model.camera_optimizer.pose_adjustment]
    layer = outputs["rgb_distractor"].sum() + outputs["alpha_distractor"].sum()
    for name in ("means", "opacities"):
        assert reaches([distractors_of(model, 1)[name]], layer)
    assert not reaches(pose, layer)
    assert reaches(pose, outputs["rgb_static"].sum())
    losses = model.get_loss_dict(outputs, {"image": trainer.photo})
    for name in ("main_loss", "static_photometric"):
        if name in losses:
            alone = distractors.static_alone and name == "main_loss"
            assert reaches(pose, losses[name]) != alone


def reaches(parameters: list[torch.nn.Parameter], value: torch.Tensor) -> bool:
    """Whether a value has a gradient in any of the parameters."""
    gradients = torch.autograd.grad(value, parameters, retain_graph=True, allow_unused=True)
    return any(gradient is not None and bool(gradient.any()) for gradient in gradients)


def test_what_a_mask_leaves_out_is_nothing_to_the_static_loss_and_the_rest_is():
    model = make_model(distractors=EVERYWHERE)
    trainer = Trainer(model)
    trainer.step(0)
    outputs = model(camera(0))
    mask = torch.ones(HEIGHT, WIDTH, 1)
    mask[:, : WIDTH // 2] = 0

    def loss(photo: torch.Tensor) -> float:
        batch = {"image": photo, "mask": mask}
        return model.get_loss_dict(outputs, batch)["static_photometric"].item()

    other = 1 - trainer.photo
    assert loss(torch.where(mask == 0, other, trainer.photo)) == loss(trainer.photo)
    assert loss(torch.where(mask == 1, other, trainer.photo)) != loss(trainer.photo)


@pytest.mark.parametrize(("columns", "counts"), [(2, True), (1, False)])
def test_a_pixel_of_smaller_photos_counts_if_at_least_half_of_it_does(columns, counts):
    model = make_model(train_downscale=4)
    mask = torch.zeros(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :columns] = True
    smaller = model.mask_of({"mask": mask}, model.device)
    assert smaller is not None
    assert smaller.shape == (HEIGHT // 4, WIDTH // 4, 1)
    assert smaller[:, 0].all().item() is counts
    assert not smaller[:, 1:].any()
