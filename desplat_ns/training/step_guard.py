"""Keeps losses and gradients that are not finite from being learned: of an unsound step nothing
stays, neither in parameters and moments nor in what densification and placement remember."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import torch
from nerfstudio.engine.optimizers import Optimizers
from torch import Tensor, nn
from torch.cuda.amp.grad_scaler import GradScaler
from torch.nn.utils import get_total_norm
from torch.optim import Optimizer

from desplat_ns.core.console import announce
from desplat_ns.core.errors import TrainingError
from desplat_ns.data.training_views import view_name

MOST_SKIPPED = 10
"""A run stops after this number of skipped steps one after the other: no photo is learned then."""


class GuardedOptimizers(Optimizers):
    """Optimizers that step, together with that of the drawn view, only if the step is sound."""

    def __init__(
        self,
        config: dict[str, Any],
        param_groups: dict[str, list[nn.Parameter]],
        model: Callable[[], Any],
    ):
        """`model`: gives the `DeSplatModel`, whose step is judged."""
        super().__init__(config, param_groups)
        self._model = model
        self.is_logged = True
        """Whether the rates of the step at hand are."""
        self.skipped_in_a_row = 0
        self._photos: set[str] = set()
        self._last = ""

    @property
    def exhausted(self) -> bool:
        """Whether the run is to stop."""
        return self.skipped_in_a_row >= MOST_SKIPPED

    def optimizer_scaler_step_some(self, grad_scaler: GradScaler, param_groups: list[str]) -> None:
        """Step, or change nothing, drop all gradients and say so once for each photo; nerfstudio
        1.1.5 steps no other way."""
        model = self._model()
        of_view = model.view_optimizers()
        every = [*self.optimizers.values(), *of_view.values()]
        if is_sound(model.train_step.losses.values(), every):
            self.skipped_in_a_row = 0
            super().optimizer_scaler_step_some(grad_scaler, param_groups)
            for optimizer in of_view.values():
                grad_scaler.step(optimizer)
            return
        self.skipped_in_a_row += 1
        photo = view_name(model.names, model.train_step.index)
        self._last = f"At step {model.step}, in the photo {photo}, a loss or gradient is not finite"
        if photo not in self._photos:
            self._photos.add(photo)
            what = "The step is skipped, and so are others of this photo if they are like it."
            announce(f"{self._last}. {what}", warning=True)
        model.train_step = None  # a refinement or reset that was due follows at the next one
        for optimizer in every:
            optimizer.zero_grad()

    def scheduler_step_all(self, step: int) -> None:
        """nerfstudio's, which logs all rates at every step; here where a step is logged."""
        if self.is_logged:
            super().scheduler_step_all(step)
            return
        for scheduler in self.schedulers.values():
            scheduler.step()

    def error(self, saved: Path) -> TrainingError:
        """Why the run stopped, and what to do. `saved`: the checkpoint of the sound state."""
        return TrainingError(
            f"{self.skipped_in_a_row} steps one after the other were skipped. {self._last}. The "
            f"state without these steps is saved as {saved}. Give a lower "
            "--optimizers.GROUP.optimizer.lr, or try --pipeline.model.backend torch to rule out "
            f"the rasterizer; then go on with `--load-checkpoint {saved}`."
        )


@torch.no_grad()
def is_sound(losses: Iterable[Tensor], optimizers: Iterable[Optimizer]) -> bool:
    """Whether the sum of squares of the terms of the loss and of all gradients is finite: none is
    NaN, infinite, or so large (1.8e19 in float32) that Adam's second moment would stay infinite."""
    parameters = (p for each in optimizers for group in each.param_groups for p in group["params"])
    gradients = [p.grad for p in parameters if p.grad is not None]
    norms = [get_total_norm(gradients, foreach=True)] if gradients else []
    every = torch.stack([*losses, *norms])
    return math.isfinite(torch.dot(every, every).item())
