"""Wiring: which layers are drawn when, what the loss sees, what a checkpoint brings back."""

from dataclasses import replace

import pytest
import torch
from nerfstudio.cameras.camera_optimizers import CameraOptimizerConfig

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.errors import CaptureError, DeSplatError
from desplat_ns.distractors import refinement
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.refinement import DistractorDensifier
from desplat_ns.layers import composite_alpha, over_background
from tests.helpers.small_model import Trainer, camera, distractors_of, make_model


def test_training_draws_the_distractors_of_that_view_over_the_static_scene():
    model = make_model()
    outputs = Trainer(model).step(0, view=1)["outputs"]
    both = over_background(
        outputs["rgb_distractor"], outputs["alpha_distractor"], outputs["rgb_static"]
    )
    alpha = composite_alpha(outputs["alpha_distractor"], outputs["accumulation"])
    expected = over_background(both, alpha, torch.zeros(3)).clamp(0, 1)
    assert torch.allclose(outputs["rgb"], expected, atol=1e-6)
    assert outputs["alpha_distractor"].mean() > 0.05
    moved = [distractors_of(model, view)["means"].grad is not None for view in range(3)]
    assert moved == [False, True, False]


def test_an_effect_that_is_off_leaves_no_trace():
    model = make_model(effects=EffectsConfig(distractors=False))
    assert model.distractors is None
    assert not any("distractor" in name for name in model.get_param_groups())
    assert not any("distractor" in name or "image_effects" in name for name in model.state_dict())
    result = Trainer(model).step(0)
    assert not any("distractor" in name for name in result["outputs"])
    assert set(result["losses"]) == {"main_loss"}


def test_the_loss_is_equation_5():
    model = make_model(distractors=DistractorConfig(per_view=20, lambda_d=0.5, lambda_s=0.25))
    result = Trainer(model).step(0)
    outputs, losses = result["outputs"], result["losses"]
    opacity = outputs["alpha_distractor"].double().mean().item()
    transparency = 1 - outputs["accumulation"].double().mean().item()
    assert losses["distractor_opacity"].item() == pytest.approx(0.5 * opacity, rel=1e-5)
    assert losses["static_transparency"].item() == pytest.approx(0.25 * transparency, rel=1e-5)


def test_the_static_opacity_is_reset_and_that_of_distractors_is_not():
    config = {"refine_every": 1, "warmup_length": 0, "cull_alpha_thresh": 0.1}
    model = make_model(reset_alpha_every=4, schedule_scale=0.01, **config)  # nominal step 400
    with torch.no_grad():
        model.gauss_params["opacities"].fill_(3.0)
        distractors_of(model, 0)["opacities"].fill_(3.0)
    Trainer(model).step(4)
    assert (torch.sigmoid(model.opacities) < 0.21).all()
    assert (torch.sigmoid(distractors_of(model, 0)["opacities"]) > 0.9).all()


def test_distractors_that_the_photo_does_not_show_are_pruned(monkeypatch):
    monkeypatch.setattr(refinement, "MIN_PIXELS", 0.05)
    monkeypatch.setattr(refinement, "GROW_GRAD", 1e9)
    model = make_model(warmup_length=0)
    by_pixels = replace(model.config.distractors, start="residual")
    model.distractors.densifier = DistractorDensifier(by_pixels, model.config, every=1)
    with torch.no_grad():
        distractors_of(model, 0)["opacities"].fill_(2.0)
        distractors_of(model, 0)["means"][3, 0] += 5.0
    trainer = Trainer(model)
    trainer.step(0)
    assert len(model.distractors.views[0]) == 20  # in the warm-up
    trainer.step(1)
    assert len(model.distractors.views[0]) == 19


@pytest.mark.slow
@pytest.mark.parametrize(
    "config",
    [
        {"sh_degree": 0, "use_absgrad": False, "densify_grad_thresh": 1e-5},
        {"rasterize_mode": "antialiased", "use_bilateral_grid": True},
        {"random_init": True, "num_random": 50, "random_scale": 1.0},
    ],
)
def test_splatfactos_options_train_and_refine(config):
    model = make_model(warmup_length=0, refine_every=2, **config)
    trainer = Trainer(model)
    losses = [trainer.step(step)["losses"]["main_loss"].item() for step in range(10)]
    assert min(losses[1:]) < losses[0]
    assert all(torch.isfinite(p).all() for p in model.parameters())


def test_a_corrected_pose_is_that_of_training_views_only():
    model = make_model(camera_optimizer=CameraOptimizerConfig(mode="SO3xR3")).eval()
    straight = model.get_outputs_for_camera(camera(1))
    held_out = model.get_outputs_for_camera(camera())
    with torch.no_grad():
        model.camera_optimizer.pose_adjustment[:, 0] = 0.3
    assert not torch.allclose(model.get_outputs_for_camera(camera(1))["rgb"], straight["rgb"])
    assert torch.equal(model.get_outputs_for_camera(camera())["rgb"], held_out["rgb"])


def test_an_empty_static_scene_ends_the_run():
    model = make_model(warmup_length=9, refine_every=1)
    trainer = Trainer(model)
    trainer.step(9)
    with torch.no_grad():
        model.gauss_params["opacities"].fill_(-9.0)
    with pytest.raises(DeSplatError, match="step 10"):
        trainer.step(10)


@pytest.mark.parametrize("number", [0, 3])
def test_too_few_points_are_refused(number):
    with pytest.raises(CaptureError, match="random-init"):
        make_model(points=torch.rand(number, 3).repeat(4, 1))


def test_points_several_times_at_one_place_make_the_gaussians_that_they_make_once():
    points = torch.rand(30, 3)
    once, often = make_model(points), make_model(points.repeat(4, 1))
    assert torch.equal(often.means, once.means) and torch.equal(often.scales, once.scales)
