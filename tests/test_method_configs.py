"""`desplat-paper` has Splatfacto's numbers where App. B.3 has no others."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import method_configs as upstream

from desplat_ns.gaussians.distractor_config import rates_at
from desplat_ns.method_configs import (
    desplat_paper,
)
from desplat_ns.training.optimizers import FusedAdamConfig

PAPER: Any = desplat_paper.config
SPLATFACTO: Any = upstream["splatfacto"]


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
