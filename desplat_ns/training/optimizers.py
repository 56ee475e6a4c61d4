"""The optimizers of a run, as nerfstudio's configurations."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

from nerfstudio.engine.optimizers import AdamOptimizerConfig
from torch import nn
from torch.optim import Optimizer

from desplat_ns.gaussians.adam import adam

SHORT_RUN_GROUPS = ("means", "scales", "quats", "features_dc", "features_rest")
"""Groups whose rates are raised in short runs: the static set's. Its opacities have rates for short
runs already, and distractors have visits of their own."""


def raised_rates(optimizers: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers` in which the rates of `SHORT_RUN_GROUPS` are
    multiplied; where a rate decays, what it decays to stays."""
    raised = dict(optimizers)
    for name in SHORT_RUN_GROUPS:
        if name in raised and factor != 1.0:
            optimizer = copy(raised[name]["optimizer"])
            optimizer.lr *= factor
            raised[name] = {**raised[name], "optimizer": optimizer}
    return raised


@dataclass
class FusedAdamConfig(AdamOptimizerConfig):
    """nerfstudio's Adam with one switch more."""

    fused: bool = True
    """Let torch update moments and parameters in one pass (a third of the time on a CPU). Where it
    cannot, it takes several passes, to the same values up to rounding."""

    def setup(self, params: list[nn.Parameter]) -> Optimizer:
        """The optimizer of one group of parameters."""
        return adam(params, self.lr, self.fused, eps=self.eps, weight_decay=self.weight_decay)
