"""Adam in one pass over the parameters, where torch can, and over those of the drawn view alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import Any

import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from torch import nn
from torch.cuda.amp.grad_scaler import GradScaler
from torch.optim import Optimizer

from desplat_ns.gaussians.parameters_of_views import ParametersOfViews

RAISED = ("means", "scales", "quats", "features_dc", "features_rest")
"""Groups whose rates are raised in short runs: the static set's. Its opacities have rates for short
runs already, and distractors have visits of their own."""


def raised_rates(optimizers: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """A copy of a TrainerConfig's `optimizers` in which the rates of `RAISED` are multiplied; where
    a rate decays, what it decays to stays."""
    raised = dict(optimizers)
    for name in RAISED:
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
        options: dict[str, Any] = {
            "lr": self.lr,
            "eps": self.eps,
            "weight_decay": self.weight_decay,
        }
        if self.fused:
            try:
                return torch.optim.Adam(params, fused=True, **options)
            except RuntimeError:  # parameters on a device, or of a type, without a fused Adam
                pass
        return torch.optim.Adam(params, **options)


class OptimizersOfViews(Optimizers):
    """nerfstudio's optimizers, whose steps cost the same however many training views there are.

    Adam updates what has a gradient: of the distractors those of the view that was drawn. To find
    them, torch and nerfstudio 1.1.5 look at every view's, four times a step for each kind of
    parameter, which took some 20 ms for 1,700 views.
    """

    def __init__(self, config: dict[str, Any], param_groups: dict[str, list[nn.Parameter]]):
        """`param_groups`: as the model gives them, `ParametersOfViews` among them."""
        super().__init__(config, param_groups)
        self._drawn = {
            name: parameters.drawn
            for name, parameters in param_groups.items()
            if isinstance(parameters, ParametersOfViews)
        }

    @contextmanager
    def drawn_alone(self) -> Iterator[None]:
        """Within, optimizers of every view's parameters hold those of the drawn views alone."""
        groups = {name: self.optimizers[name].param_groups[0] for name in self._drawn}
        whole = {name: group["params"] for name, group in groups.items()}
        for name, group in groups.items():
            group["params"] = [whole[name][view] for view in self._drawn[name]]
        try:
            yield
        finally:
            for name, group in groups.items():
                group["params"] = whole[name]

    def zero_grad_all(self) -> None:
        """Drop all gradients."""
        with self.drawn_alone():
            super().zero_grad_all()

    def zero_grad_some(self, param_groups: list[str]) -> None:
        """Drop the gradients of some groups."""
        with self.drawn_alone():
            super().zero_grad_some(param_groups)

    def optimizer_scaler_step_some(self, grad_scaler: GradScaler, param_groups: list[str]) -> None:
        """Step the optimizers of some groups."""
        with self.drawn_alone():
            super().optimizer_scaler_step_some(grad_scaler, param_groups)
