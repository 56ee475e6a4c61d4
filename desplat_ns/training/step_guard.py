"""Catches losses, gradients and parameters that are not finite before they are learned or saved.

A step is judged between its backward pass and its optimizer step. If it is unsound, nothing of it
stays: not in parameters and moments, not in what densification and placement remember.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from nerfstudio.engine.optimizers import Optimizers
from nerfstudio.utils import writer
from torch import Tensor, nn
from torch.cuda.amp.grad_scaler import GradScaler
from torch.optim import Optimizer

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, TrainingError
from desplat_ns.training.checkpoint_files import checkpoints_in
from desplat_ns.training.culled import too_many_culled

ADVICE = (
    "Look at that photo and its pose, give a lower --optimizers.GROUP.optimizer.lr for a group "
    "that is named, or try --pipeline.model.backend torch to rule out the rasterizer"
)


@dataclass(frozen=True)
class Fault:
    """What was not finite in a step."""

    losses: tuple[str, ...]
    groups: tuple[str, ...]
    """Parameter groups with an unsound gradient."""

    def __str__(self) -> str:
        parts = []
        if self.losses:
            parts.append(f"the loss ({', '.join(self.losses)})")
        if self.groups:
            parts.append(f"the gradient of {', '.join(self.groups)}")
        return " and ".join(parts)


def sum_of_squares(tensors: list[Tensor]) -> Float[Tensor, ""]:
    """Sum of squares of all values: not finite if one of them is not, or is so large (1.8e19 in
    float32) that Adam's second moment would stay infinite and the parameter never move again."""
    return reduce(torch.add, [torch.dot(t.flatten(), t.flatten()) for t in tensors])


def gradients_of(optimizers: Mapping[str, Optimizer]) -> dict[str, list[Tensor]]:
    """The gradients of a step, by parameter group; groups without any are left out."""
    by_group = {
        name: [
            p.grad
            for group in optimizer.param_groups
            for p in group["params"]
            if p.grad is not None
        ]
        for name, optimizer in optimizers.items()
    }
    return {name: gradients for name, gradients in by_group.items() if gradients}


@torch.no_grad()
def find_fault(
    losses: Mapping[str, Float[Tensor, ""]], gradients: Mapping[str, list[Tensor]]
) -> Fault | None:
    """What is not finite in a step, None if all is finite; that takes one pass over the memory.

    Args:
        losses: terms of the loss, by name.
        gradients: by parameter group.
    """
    sizes = {name: sum_of_squares(of_group) for name, of_group in gradients.items()}
    values = [*losses.values(), *sizes.values()]
    if not values or bool(reduce(torch.add, values).isfinite()):
        return None
    bad_losses = tuple(name for name, value in losses.items() if not bool(value.isfinite()))
    bad_groups = tuple(name for name, size in sizes.items() if not bool(size.isfinite()))
    return Fault(bad_losses, bad_groups) if bad_losses or bad_groups else None


class GuardedOptimizers(Optimizers):
    """Optimizers that step only if the step at hand is finite, with those of the drawn view."""

    def __init__(
        self,
        config: dict[str, Any],
        param_groups: dict[str, list[nn.Parameter]],
        may_step: Callable[[], bool],
        of_view: Callable[[], Mapping[str, Optimizer]],
    ):
        """Args:
        may_step: is called after each backward pass.
        of_view: gives the optimizers that belong to the view of the step at hand.
        """
        super().__init__(config, param_groups)
        self._may_step, self._of_view = may_step, of_view
        self.is_logged = True
        """Whether the rates of the step at hand are."""

    def optimizer_scaler_step_some(self, grad_scaler: GradScaler, param_groups: list[str]) -> None:
        """Step, or change nothing and drop all gradients; nerfstudio 1.1.5 steps no other way."""
        of_view = self._of_view()  # first: a step that is dropped has no view any more
        if self._may_step():
            super().optimizer_scaler_step_some(grad_scaler, param_groups)
            for name in gradients_of(of_view):
                grad_scaler.step(of_view[name])
            return
        for optimizer in (*self.optimizers.values(), *of_view.values()):
            optimizer.zero_grad()

    def scheduler_step_all(self, step: int) -> None:
        """nerfstudio's, which logs all rates at every step; here where a step is logged, those of
        the view as well."""
        if not self.is_logged:
            for scheduler in self.schedulers.values():
                scheduler.step()
            return
        super().scheduler_step_all(step)
        for name, optimizer in self._of_view().items():
            rate = optimizer.param_groups[0]["lr"]
            writer.put_scalar(name=f"learning_rate/{name}", scalar=rate, step=step)


@runtime_checkable
class GuardedModel(Protocol):
    """What guards ask of a model."""

    losses: dict[str, Tensor]
    """The terms of the step at hand, by name."""

    @property
    def num_points(self) -> int:
        """Number of static Gaussians."""
        ...

    def view_name(self) -> str:
        """The training photo of the step at hand."""
        ...

    def drop_step(self) -> None:
        """Forget the step at hand."""
        ...

    def gaussian_groups(self) -> set[str]:
        """Parameter groups with one row for each Gaussian."""
        ...

    def view_optimizers(self) -> Mapping[str, Optimizer]:
        """Optimizers of what belongs to the view of the step at hand alone."""
        ...

    def view_parameters(self) -> Mapping[str, Sequence[Tensor]]:
        """What belongs to single views, of all of them; one row for each Gaussian."""
        ...

    def culled_static(self) -> int:
        """Static Gaussians that no view shows."""
        ...


class StepGuard:
    """Judges steps, and counts those that were skipped."""

    def __init__(self, max_skipped: int):
        """`max_skipped`: so many skipped steps, in all, and the run is to stop.

        In all and not in a row: one photo that always fails would never make a row.
        Raises ConfigError where it is below 1.
        """
        if max_skipped < 1:
            raise ConfigError(
                f"--max-skipped-steps is {max_skipped}; it has to be 1 (stop at the first) or more."
            )
        self.max_skipped = max_skipped
        self.skipped = 0
        self.skipped_last = False
        self._last = ""

    @property
    def exhausted(self) -> bool:
        """Whether the run is to stop."""
        return self.skipped >= self.max_skipped

    def is_finite(self, step: int, model: GuardedModel, optimizers: Optimizers) -> bool:
        """Whether the optimizers may take `step`; if not, that is said and the model drops it."""
        judged = gradients_of({**optimizers.optimizers, **model.view_optimizers()})
        fault = find_fault(model.losses, judged)
        self.skipped_last = fault is not None
        if fault is None:
            return True
        self.skipped += 1
        photo = model.view_name()
        self._last = f"At step {step}, in the photo {photo}: {fault} is not finite"
        announce(
            f"{self._last}. The step is skipped ({self.skipped} of at most "
            f"{self.max_skipped}); nothing has changed.",
            warning=True,
        )
        model.drop_step()
        return False

    def error(self, saved: Path) -> TrainingError:
        """Why the run stopped, and what to do. `saved`: the checkpoint of the sound state."""
        return TrainingError(
            f"{self.skipped} steps were skipped because a loss or gradient was not finite. The "
            f"last: {self._last}. The state without these steps is saved as {saved}. {ADVICE}; "
            f"then go on with `--load-checkpoint {saved}`. --max-skipped-steps, now "
            f"{self.max_skipped}, says when to stop."
        )


def check_parameters(
    model: GuardedModel, optimizers: Optimizers, step: int, folder: Path, strict: bool
) -> None:
    """Refuse to save parameters from which no training can go on.

    Gaussians may be culled, as long as most are not: each is a row of its own. All else (networks,
    embeddings, poses) must be finite.

    Args:
        folder: of the run's checkpoints.
        strict: nothing may be culled either: where the last step was skipped, that may be why.

    Raises:
        TrainingError: what is not finite, and which checkpoint is the newest.
    """
    per_gaussian = set() if strict else model.gaussian_groups()
    groups: dict[str, Sequence[Tensor]] = {
        name: list(_parameters(optimizer))
        for name, optimizer in optimizers.optimizers.items()
        if name not in per_gaussian
    }
    if strict:
        groups = {**groups, **model.view_parameters()}
    bad = [n for n, group in groups.items() if not all(bool(p.isfinite().all()) for p in group)]
    fault = f"The parameters {', '.join(bad)} are not finite" if bad else None
    if fault is None:
        fault = too_many_culled(model.culled_static(), model.num_points)
    if fault is None:
        return
    saved = checkpoints_in(folder) if folder.is_dir() else []
    newest = (
        f"The newest checkpoint, {saved[-1]}, is untouched: go on from it with "
        f"`--load-checkpoint {saved[-1]}`"
        if saved
        else "There is no earlier checkpoint: start anew"
    )
    raise TrainingError(
        f"{fault} after step {step}, although every loss and gradient was. This state is not "
        f"saved. {newest}, and a lower --optimizers.GROUP.optimizer.lr."
    )


def _parameters(optimizer: Optimizer) -> Iterator[Tensor]:
    for group in optimizer.param_groups:
        yield from group["params"]
