"""Distractors' rates are those of App. B.3, and Splatfacto's where it has none."""

from typing import Any

import pytest
import torch
from nerfstudio.configs.method_configs import method_configs as upstream

from desplat_ns.distractors.config import rates_at
from desplat_ns.method_configs import desplat_paper

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
