"""Which gradient reaches what: the background, the pose, and pixels that the user masked."""

import pytest
import torch
from nerfstudio.cameras.camera_optimizers import CameraOptimizerConfig

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.distractors.config import DistractorConfig
from tests.helpers.small_model import HEIGHT, WIDTH, Trainer, camera, distractors_of, make_model


def reaches(parameters: list[torch.nn.Parameter], value: torch.Tensor) -> bool:
    """Whether a value has a gradient in any of the parameters."""
    gradients = torch.autograd.grad(value, parameters, retain_graph=True, allow_unused=True)
    return any(gradient is not None and bool(gradient.any()) for gradient in gradients)


@pytest.mark.parametrize("alone", [True, False])
def test_alone_the_static_scene_its_background_and_the_poses_learn_from_its_own_loss_only(alone):
    """And distractors, which hang right before the camera, pull on no pose: all of it would fit
    them."""
    effects = EffectsConfig(background="image")
    poses = CameraOptimizerConfig(mode="SO3xR3")
    distractors = DistractorConfig(per_view=20, static_alone=alone)
    model = make_model(effects=effects, camera_optimizer=poses, distractors=distractors)
    trainer = Trainer(model)
    model.train()
    model.optimizers = trainer.optimizers
    outputs = model(camera(1))
    losses = model.get_loss_dict(outputs, {"image": trainer.photo})
    pose = [model.camera_optimizer.pose_adjustment]
    background = list(model.image_effects.background.parameters())
    gaussians = [model.gauss_params["features_dc"], model.gauss_params["opacities"]]
    for parameters in (pose, background, gaussians):
        assert reaches(parameters, losses["main_loss"]) != alone
        assert not reaches(parameters, losses["distractor_opacity"])
        if alone:
            assert reaches(parameters, losses["static_photometric"])
    layer = outputs["rgb_distractor"].sum() + outputs["alpha_distractor"].sum()
    for name in ("means", "opacities"):
        assert reaches([distractors_of(model, 1)[name]], layer)
    assert not reaches(pose, layer)


@pytest.mark.parametrize(("columns", "counts"), [(2, True), (1, False)])
def test_a_pixel_of_smaller_photos_counts_if_at_least_half_of_it_does(columns, counts):
    model = make_model(train_downscale=4)
    mask = torch.zeros(HEIGHT, WIDTH, 1, dtype=torch.bool)
    mask[:, :columns] = True
    smaller = model.mask_of({"mask": mask}, model.device)
    assert smaller.shape == (HEIGHT // 4, WIDTH // 4, 1)
    assert smaller[:, 0].all().item() is counts
    assert not smaller[:, 1:].any()
