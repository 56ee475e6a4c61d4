"""The methods with `-paper` have the numbers of App. B.3 and of Splatfacto."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import method_configs as upstream

from desplat_ns.gaussians.distractor_config import STOP_DENSIFY_AT, DistractorConfig, rates_at
from desplat_ns.method_configs import (
    desplat_paper,
    desplat_phototourism,
    desplat_phototourism_a_paper,
    desplat_phototourism_paper,
)
from desplat_ns.settings.effects import Effects
from desplat_ns.training.optimizers import FusedAdamConfig

PAPER: Any = desplat_paper.config
TOURISM: Any = desplat_phototourism_paper.config
TOURISM_A: Any = desplat_phototourism_a_paper.config
SPLATFACTO: Any = upstream["splatfacto"]


def test_schedule_of_b3():
    assert PAPER.max_num_iterations == PAPER.nominal_num_iterations == 30_000
    model = PAPER.pipeline.model
    distractors = model.distractors
    assert distractors == DistractorConfig()
    assert distractors.per_view == 1000
    assert STOP_DENSIFY_AT == 15_000
    assert distractors.lambda_d == distractors.lambda_s == 0.01
    assert (distractors.static_warmup, distractors.static_alone) == (0, False)
    assert model.opacity_prior == model.near_plane == model.gaussians_per_pixel == 0
    assert model.for_run(400).refine_every == 100


def test_distractor_learning_rates_are_b3s_and_splatfactos():
    b3 = {"quats": 0.01, "scales": 0.05, "rgbs": 0.025}
    theirs = {k: SPLATFACTO.optimizers[k]["optimizer"].lr for k in ("means", "opacities")}
    assert rates_at(0) == b3 | theirs
    optimizer = torch.optim.Adam([torch.nn.Parameter(torch.zeros(1))], lr=1.6e-4)
    scheduler = PAPER.optimizers["means"]["scheduler"].setup().get_scheduler(optimizer, 1.6e-4)
    for step in (0, 700, 30_000, 40_000):
        rate = 1.6e-4 * scheduler.lr_lambdas[0](step)
        assert rates_at(step)["means"] == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("group", sorted(SPLATFACTO.optimizers))
def test_static_optimizers_are_splatfactos(group: str):
    ours, theirs = PAPER.optimizers[group], SPLATFACTO.optimizers[group]
    assert isinstance(ours["optimizer"], FusedAdamConfig)
    assert vars(ours["optimizer"]) == vars(theirs["optimizer"])
    if theirs["scheduler"] is None:
        assert ours["scheduler"] is None
    else:
        for name in ("lr_final", "max_steps", "warmup_steps", "ramp"):
            assert getattr(ours["scheduler"], name) == getattr(theirs["scheduler"], name)


def test_the_model_keeps_splatfactos_numbers():
    theirs = vars(SPLATFACTO.pipeline.model)
    ours = vars(PAPER.pipeline.model)
    assert {name for name, value in theirs.items() if ours[name] != value} == {"_target"}


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
def test_learning_rates_of_photo_tourism_in_b3(config: Any, group: str, rate: float, final: Any):
    options = config.optimizers[group]
    assert options["optimizer"].lr == rate
    assert (options["scheduler"] and options["scheduler"].lr_final) == final


@pytest.mark.parametrize(
    ("config", "background", "lambdas"),
    [(TOURISM, "image", (0.01, 0.15)), (TOURISM_A, "off", (0.01, 0.0))],
)
def test_weights_and_sizes_of_photo_tourism_in_b3(config: Any, background: Any, lambdas: Any):
    model = config.pipeline.model
    effects, run = model.effects.settled(), model.for_run(100)
    assert effects == Effects(appearance="affine", background=background)
    lambda_bg = 0.0 if background == "off" else run.background.lambda_bg
    assert (run.distractors.lambda_d, lambda_bg) == lambdas
    assert config.max_num_iterations == 200_000
    evaluation = config.pipeline.evaluation
    assert (evaluation.steps, evaluation.learning_rate) == (128, 0.01)


def test_tourists_photos_have_a_light_each_and_a_sky():
    effects = desplat_phototourism.config.pipeline.model.effects.settled()  # type: ignore[attr-defined]
    assert effects == Effects(distractors=True, appearance="affine", background="image")
