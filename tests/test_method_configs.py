"""`desplat-paper` has the numbers of App. B.3 and of Splatfacto; `desplat` changes a few."""

import dataclasses
from typing import Any

import pytest
from nerfstudio.configs.method_configs import method_configs as upstream

from desplat_ns.distractors import DistractorConfig
from desplat_ns.method_configs import desplat, desplat_paper, separating_distractors
from desplat_ns.optimizers import FusedAdamConfig

CONFIG: Any = desplat_paper.config
SPLATFACTO: Any = upstream["splatfacto"]


def learning_rate(group: str) -> float:
    return CONFIG.optimizers[group]["optimizer"].lr


def test_schedule_of_b3():
    assert CONFIG.max_num_iterations == CONFIG.nominal_num_iterations == 30_000
    distractors = CONFIG.pipeline.model.distractors
    assert distractors.per_view == 1000
    assert distractors.stop_densify_at == 15_000
    assert distractors.lambda_d == distractors.lambda_s == 0.01
    assert distractors.static_warmup == 0
    assert distractors.start == "everywhere"
    assert not distractors.static_alone
    assert CONFIG.pipeline.model.ssim_lambda == 0.2


@pytest.mark.parametrize(("group", "rate"), [("quats", 0.01), ("scales", 0.05), ("rgbs", 0.025)])
def test_distractor_learning_rates_of_b3(group, rate):
    assert learning_rate(f"distractor_{group}") == rate


@pytest.mark.parametrize("group", ["means", "opacities"])
def test_the_other_distractor_learning_rates_are_splatfactos(group):
    assert learning_rate(f"distractor_{group}") == SPLATFACTO.optimizers[group]["optimizer"].lr


@pytest.mark.parametrize("group", sorted(SPLATFACTO.optimizers))
def test_static_optimizers_are_splatfactos(group):
    ours, theirs = CONFIG.optimizers[group], SPLATFACTO.optimizers[group]
    assert isinstance(ours["optimizer"], FusedAdamConfig)
    assert vars(ours["optimizer"]) == vars(theirs["optimizer"]) | {"fused": True}
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


def test_the_methods_differ_in_their_distractors_alone():
    ours: Any = desplat.config
    assert ours.pipeline.model.distractors == separating_distractors() != DistractorConfig()
    paper = dataclasses.replace(ours.pipeline.model, distractors=DistractorConfig())
    assert paper == CONFIG.pipeline.model
    assert ours.optimizers == CONFIG.optimizers
    assert ours.max_num_iterations == CONFIG.max_num_iterations
    assert (ours.method_name, CONFIG.method_name) == ("desplat", "desplat-paper")
