"""A training loop with the step guard, on small models with all that is remembered."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch
from torch import Tensor

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.training.optimizers import FusedAdamConfig
from desplat_ns.training.step_guard import (
    GuardedOptimizers,
    StepGuard,
)
from tests.helpers.small_model import NUM_VIEWS, camera, make_model
from tests.helpers.stub_run import config as config  # a fixture


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


class GuardedTrainer:
    """nerfstudio's order of things in a step, around the model of test_model.py."""

    def __init__(self, model: DeSplatModel):
        self.model, self.step_at_hand = model, 0
        self.scaler = torch.cuda.amp.GradScaler(enabled=False)
        groups = {name: params for name, params in model.get_param_groups().items() if params}
        rates = {name: 1e-4 if "means" in name else 1e-2 for name in groups}
        options = {
            name: {"optimizer": FusedAdamConfig(lr=rate), "scheduler": None}
            for name, rate in rates.items()
        }
        self.guard = StepGuard()
        self.optimizers = GuardedOptimizers(options, groups, self._may_step, model.view_optimizers)
        self.photo = torch.rand(20, 24, 3, generator=torch.Generator().manual_seed(1))

    def _may_step(self) -> bool:
        model, optimizers = self.model, self.optimizers.optimizers
        judged = (*optimizers.values(), *model.view_optimizers().values())
        if self.guard.is_sound(self.step_at_hand, model.view_name(), model.losses.values(), judged):
            return True
        model.drop_step()
        return False

    def step(self, step: int, spoil: Any = None, photo: Tensor | None = None) -> None:
        model, self.step_at_hand = self.model, step
        model.train()
        model.step, model.optimizers = step, self.optimizers.optimizers
        self.optimizers.zero_grad_all()
        outputs = model(camera(step % NUM_VIEWS))
        batch = {"image": self.photo if photo is None else photo}
        losses = model.get_loss_dict(outputs, batch)
        torch.stack(list(losses.values())).sum().backward()
        if spoil is not None:
            spoil()
        self.optimizers.optimizer_scaler_step_some(self.scaler, list(self.optimizers.optimizers))
        model.step_post_backward(step)

    def state(self) -> dict[str, Any]:
        """All that a checkpoint holds of the model and its optimizers, moments included."""
        adams = {name: adam.state_dict() for name, adam in self.optimizers.optimizers.items()}
        return copy.deepcopy({"model": self.model.state_dict(), "adam": adams})


def a_model() -> DeSplatModel:
    """Both sets are refined every third step, with all that is remembered."""
    distractors = DistractorConfig(
        per_view=20, start="residual", static_alone=True, static_warmup=2
    )
    steps: dict[str, Any] = {"warmup_length": 2, "refine_every": 3, "densify_grad_thresh": 1e-9}
    points = torch.rand(40, 3, generator=torch.Generator().manual_seed(2)) - 0.5
    model = make_model(points, distractors=distractors, **steps)
    assert model.layer is not None
    model.layer.densifier.every = 3
    return model


def everywhere() -> DeSplatModel:
    """As in the paper; both sets are refined every third step."""
    distractors = DistractorConfig(per_view=20, refine_visits=1)
    return make_model(distractors=distractors, warmup_length=2, refine_every=3)
