"""Keeps losses, gradients and parameters that are not finite from being learned or saved.

A step is judged between its backward pass and its optimizer step. If it is unsound, nothing of it
stays: not in parameters and moments, not in what densification and placement remember.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from nerfstudio.engine.optimizers import Optimizers
from nerfstudio.utils import writer
from torch import Tensor, nn
from torch.cuda.amp.grad_scaler import GradScaler
from torch.optim import Optimizer

from desplat_ns.backend.constants import FAR_PLANE
from desplat_ns.console import announce
from desplat_ns.errors import TrainingError

MOST_SKIPPED = 10
"""A run stops after this number of skipped steps one after the other: no photo is learned then."""

MOST_BROKEN_SHARE = 0.5
"""A static scene of which more than this share can be drawn in no view is not saved."""


class GuardedOptimizers(Optimizers):
    """Optimizers that step, together with those of the drawn view, only if the step is sound."""

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
        if is_sound(model.losses.values(), every):
            self.skipped_in_a_row = 0
            super().optimizer_scaler_step_some(grad_scaler, param_groups)
            for optimizer in of_view.values():
                grad_scaler.step(optimizer)
            return
        self.skipped_in_a_row += 1
        photo = model.view_name()
        self._last = f"At step {model.step}, in the photo {photo}, a loss or gradient is not finite"
        if photo not in self._photos:
            self._photos.add(photo)
            what = "The step is skipped, and so are others of this photo if they are like it."
            announce(f"{self._last}. {what}", warning=True)
        model.drop_step()
        for optimizer in every:
            optimizer.zero_grad()

    def scheduler_step_all(self, step: int) -> None:
        """nerfstudio's, which logs all rates at every step; here where a step is logged, those of
        the view as well."""
        if not self.is_logged:
            for scheduler in self.schedulers.values():
                scheduler.step()
            return
        super().scheduler_step_all(step)
        for name, optimizer in self._model().view_optimizers().items():
            rate = optimizer.param_groups[0]["lr"]
            writer.put_scalar(name=f"learning_rate/{name}", scalar=rate, step=step)

    def error(self, saved: Path) -> TrainingError:
        """Why the run stopped, and what to do. `saved`: the checkpoint of the sound state."""
        return TrainingError(
            f"{self.skipped_in_a_row} steps one after the other were skipped. {self._last}. The "
            f"state without these steps is saved as {saved}. Give a lower "
            "--optimizers.GROUP.optimizer.lr, or try --pipeline.model.backend torch to rule out "
            f"the rasterizer; then go on with `--load-checkpoint {saved}`."
        )


def parameters_of(optimizer: Optimizer) -> list[Tensor]:
    """All parameters that an optimizer moves."""
    return [parameter for group in optimizer.param_groups for parameter in group["params"]]


def sum_of_squares(tensors: list[Tensor]) -> Float[Tensor, ""]:
    """Sum of squares of all values: not finite if one of them is not, or is so large (1.8e19 in
    float32) that Adam's second moment would stay infinite and the parameter never move again."""
    return reduce(torch.add, [torch.dot(t.flatten(), t.flatten()) for t in tensors])


@torch.no_grad()
def is_sound(losses: Iterable[Tensor], optimizers: Iterable[Optimizer]) -> bool:
    """Whether the terms of the loss and the gradients of all parameters are finite, which takes one
    pass over the memory."""
    gradients = [p.grad for each in optimizers for p in parameters_of(each)]
    gradients = [gradient for gradient in gradients if gradient is not None]
    values = [*losses, *([sum_of_squares(gradients)] if gradients else [])]
    return not values or bool(reduce(torch.add, values).isfinite())


@torch.no_grad()
def check_parameters(
    gaussians: Mapping[str, Tensor], optimizers: Mapping[str, Optimizer], step: int, folder: Path
) -> None:
    """Refuse to save parameters from which no training can go on.

    Args:
        gaussians: raw parameters of the static set, a row for each Gaussian. A broken row is never
            drawn and never moves again, so some may be broken.
        optimizers: of these and of all else (networks, embeddings, poses), which has to be finite.
        folder: of the run's checkpoints.

    Raises:
        TrainingError: what is not finite.
    """
    fault, broken = None, gaussians["means"].abs().amax(1) >= FAR_PLANE
    for values in gaussians.values():
        broken = broken | ~values.flatten(1).isfinite().all(1)
    if float(broken.double().mean()) > MOST_BROKEN_SHARE:
        fault = f"{int(broken.sum())} of {len(broken)} static Gaussians can be drawn in no view"
    for name, optimizer in optimizers.items():
        is_finite = all(bool(p.isfinite().all()) for p in parameters_of(optimizer))
        if name not in gaussians and not is_finite:
            fault = f"The parameters {name} are not finite"
    if fault is not None:
        raise TrainingError(
            f"{fault} after step {step}, although every loss and gradient was finite. This state "
            f"is not saved; checkpoints in {folder} are untouched. Go on from the newest with "
            f"`--load-dir {folder}`, or start anew, with a lower --optimizers.GROUP.optimizer.lr."
        )
