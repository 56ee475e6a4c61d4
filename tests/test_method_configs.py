"""`desplat-paper` has Splatfacto's numbers where App. B.3 has no others."""

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


def test_the_static_model_and_its_optimizers_keep_splatfactos_numbers():
    for group, theirs in SPLATFACTO.optimizers.items():
        ours = PAPER.optimizers[group]
        assert vars(ours["optimizer"]) == vars(theirs["optimizer"]), group
        for name in ("lr_final", "max_steps", "warmup_steps", "ramp"):
            expected = getattr(theirs["scheduler"], name, None)
            assert getattr(ours["scheduler"], name, None) == expected, (group, name)
    ours, theirs = vars(PAPER.pipeline.model), vars(SPLATFACTO.pipeline.model)
    assert {name for name, value in theirs.items() if ours[name] != value} == {"_target"}
