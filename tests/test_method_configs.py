"""`desplat-paper` has the numbers of App. B.3 and of Splatfacto; `desplat` changes a few."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import method_configs as upstream

from desplat_ns.gaussians.distractor_config import STOP_DENSIFY_AT, DistractorConfig, rates_at
from desplat_ns.method_configs import (
    desplat,
    desplat_paper,
    desplat_phototourism,
    desplat_phototourism_a_paper,
    desplat_phototourism_paper,
)
from desplat_ns.settings.effects import Effects, EffectsConfig
from desplat_ns.training.optimizers import FusedAdamConfig

CONFIG: Any = desplat_paper.config
SPLATFACTO: Any = upstream["splatfacto"]


def test_schedule_of_b3():
    assert CONFIG.max_num_iterations == CONFIG.nominal_num_iterations == 30_000
    distractors = CONFIG.pipeline.model.distractors
    assert distractors.per_view == 1000
    assert STOP_DENSIFY_AT == 15_000
    assert distractors.lambda_d == distractors.lambda_s == 0.01
    assert distractors.static_warmup == 0
    assert distractors.start == "everywhere"
    assert not distractors.static_alone
    assert CONFIG.pipeline.model.ssim_lambda == 0.2


@pytest.mark.parametrize(("group", "rate"), [("quats", 0.01), ("scales", 0.05), ("rgbs", 0.025)])
def test_distractor_learning_rates_of_b3(group, rate):
    assert rates_at(0)[group] == rate


@pytest.mark.parametrize("group", ["means", "opacities"])
def test_the_other_distractor_learning_rates_are_splatfactos(group):
    assert rates_at(0)[group] == SPLATFACTO.optimizers[group]["optimizer"].lr


def test_the_rate_of_positions_decays_as_the_static_sets():
    means = CONFIG.optimizers["means"]
    optimizer = torch.optim.Adam([torch.nn.Parameter(torch.zeros(1))], lr=1.6e-4)
    (curve,) = means["scheduler"].setup().get_scheduler(optimizer, 1.6e-4).lr_lambdas
    for step in (0, 700, 15_000, 30_000, 40_000):
        rate = 1.6e-4 * curve(step)
        assert rates_at(step)["means"] == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("group", sorted(SPLATFACTO.optimizers))
def test_static_optimizers_are_splatfactos(group):
    ours, theirs = CONFIG.optimizers[group], SPLATFACTO.optimizers[group]
    assert isinstance(ours["optimizer"], FusedAdamConfig)
    assert vars(ours["optimizer"]) == vars(theirs["optimizer"])
    if theirs["scheduler"] is None:
        assert ours["scheduler"] is None
    else:
        for name in ("lr_final", "max_steps", "warmup_steps", "ramp"):
            assert getattr(ours["scheduler"], name) == getattr(theirs["scheduler"], name)


def test_the_model_keeps_splatfactos_numbers():
    theirs = SPLATFACTO.pipeline.model
    changed = {
        name
        for name, value in vars(theirs).items()
        if getattr(CONFIG.pipeline.model, name) != value
    }
    assert changed == {"_target"}


def test_the_paper_is_refined_and_culled_like_the_splatfacto_it_was_built_on():
    model = CONFIG.pipeline.model
    assert model.refine_every == 100
    assert model.cull_to_the_end
    assert model.gaussians_per_pixel == 0
    assert model.opacity_prior == model.near_plane == 0
    assert model.for_run(400).refine_every == 100
    assert model.distractors == DistractorConfig()


def test_effects_are_surveyed_by_desplat_and_given_in_the_paper():
    ours: Any = desplat.config
    assert (ours.pipeline.model.effects.auto, CONFIG.pipeline.model.effects.auto) == (True, False)
    assert (ours.method_name, CONFIG.method_name) == ("desplat", "desplat-paper")


TOURISM: Any = desplat_phototourism_paper.config
TOURISM_A: Any = desplat_phototourism_a_paper.config


@pytest.mark.parametrize("config", [TOURISM, TOURISM_A])
@pytest.mark.parametrize(
    ("group", "rate", "final"),
    [
        ("appearance_mlp", 0.0005, None),
        ("image_embeddings", 0.001, None),
        ("appearance_features", 0.005, None),
        ("background_encoder", 0.002, 0.0001),
        ("background_sh_dc", 0.002, 0.0002),
        ("background_sh_rest", 0.0001, 0.00001),
    ],
)
def test_learning_rates_of_photo_tourism_in_b3(config, group, rate, final):
    options = config.optimizers[group]
    assert options["optimizer"].lr == rate
    assert (options["scheduler"] and options["scheduler"].lr_final) == final
    if final is not None:
        assert options["scheduler"].max_steps == 100_000  # as in the authors' code


@pytest.mark.parametrize(
    ("config", "background", "lambdas"),
    [(TOURISM, "image", (0.01, 0.15)), (TOURISM_A, "off", (0.01, 0.0))],
)
def test_weights_and_sizes_of_photo_tourism_in_b3(config, background, lambdas):
    model = config.pipeline.model
    effects, run = model.effects.settled(), model.for_run(100)
    assert effects == Effects(appearance="affine", background=background)
    lambda_bg = 0.0 if effects.background == "off" else run.background.lambda_bg
    assert (run.distractors.lambda_d, lambda_bg) == lambdas
    assert config.max_num_iterations == 200_000
    appearance, behind = model.appearance, model.background
    assert (appearance.embedding_dim, appearance.fourier_frequencies) == (32, 4)
    assert (appearance.hidden_layers, appearance.hidden_width) == (2, 128)
    assert (behind.hidden_layers, behind.hidden_width, behind.sh_degree) == (3, 128, 4)
    assert behind.max_error == 0.003
    assert (config.pipeline.evaluation.steps, config.pipeline.evaluation.learning_rate) == (
        128,
        0.01,
    )


def test_the_rest_of_photo_tourism_is_the_papers():
    for config in (TOURISM, TOURISM_A):
        ours, paper = vars(config.pipeline.model), vars(CONFIG.pipeline.model)
        assert {name for name in ours if ours[name] != paper[name]} == {"effects"}
        slower = {name for name, of in config.optimizers.items() if of != CONFIG.optimizers[name]}
        assert slower == {"background_encoder", "background_sh_dc", "background_sh_rest"}


def test_tourists_photos_get_desplat_with_light_and_sky():
    ours: Any = desplat_phototourism.config
    plain: Any = desplat.config
    mine, theirs = vars(ours.pipeline.model), vars(plain.pipeline.model)
    assert {name for name in mine if mine[name] != theirs[name]} == {"effects"}
    without_light = replace(plain.pipeline.model, effects=EffectsConfig())
    assert without_light.for_run(10).opacity_prior == plain.pipeline.model.opacity_prior
    assert ours.pipeline.model.for_run(10).opacity_prior == 0
    wanted = Effects(distractors=True, appearance="affine", background="image")
    assert ours.pipeline.model.effects.settled() == wanted
    assert ours.optimizers == plain.optimizers
    assert ours.max_num_iterations == plain.max_num_iterations


@pytest.mark.slow
def test_registering_the_methods_imports_nothing_that_only_training_needs(checkout: Path):
    """Every command of nerfstudio's registers them, also for other methods and for `--help`."""
    code = (
        "import sys, nerfstudio.configs.method_configs, desplat_ns.method_configs; "
        "print(sorted({'numba', 'pycolmap', 'torchmetrics', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=checkout, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
