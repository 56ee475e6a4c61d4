"""Training guards: what is not finite is caught where it appears, and never saved or learned from.

A step is judged between its backward pass and its optimizer step. If it is unsound, nothing of it
stays: not in parameters and moments, not in what densification and placement remember.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import torch
from desplat_ns.console import announce
from jaxtyping import Bool, Float
from nerfstudio.engine.optimizers import Optimizers
from torch import Tensor, nn
from torch.optim import Optimizer

from desplat_ns.backend.inputs import sound
from desplat_ns.backend.protocol import RenderSettings, Splats
from desplat_ns.errors import ConfigError, TrainingError
from desplat_ns.gaussians.activation import MAX_LOG_SCALE
from desplat_ns.training.checkpoint_files import checkpoints_in

TOO_WIDE = math.exp(MAX_LOG_SCALE) / 2
"""World units. Wider Gaussians are culled in every view."""

MAX_CULLED_SHARE = 0.5
"""A static scene of which more than this share can be drawn in no view is no scene any more."""

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


def size_of(tensors: list[Tensor]) -> Float[Tensor, ""]:
    """Sum of squares of all values: not finite if one of them is not, or is so large (1.8e19 in
    float32) that Adam's second moment would stay infinite and the parameter never move again."""
    return reduce(torch.add, [torch.dot(t.flatten(), t.flatten()) for t in tensors])


def gradients_of(optimizers: Mapping[str, Optimizer]) -> dict[str, list[Tensor]]:
    """The gradients of a step, by parameter group; groups without any are left out."""
    found = {
        name: [p.grad for group in one.param_groups for p in group["params"] if p.grad is not None]
        for name, one in optimizers.items()
    }
    return {name: gradients for name, gradients in found.items() if gradients}


@torch.no_grad()
def find_fault(
    losses: Mapping[str, Float[Tensor, ""]], gradients: Mapping[str, list[Tensor]]
) -> Fault | None:
    """What of a step is not finite, None if all is: the usual case, in one pass over the memory.

    Args:
        losses: terms of the loss, by name.
        gradients: by parameter group.
    """
    sizes = {name: size_of(of_group) for name, of_group in gradients.items()}
    values = [*losses.values(), *sizes.values()]
    if not values or bool(reduce(torch.add, values).isfinite()):
        return None
    bad_losses = tuple(name for name, value in losses.items() if not bool(value.isfinite()))
    bad_groups = tuple(name for name, size in sizes.items() if not bool(size.isfinite()))
    return Fault(bad_losses, bad_groups) if bad_losses or bad_groups else None


class GuardedOptimizers(Optimizers):
    """nerfstudio's optimizers, which step only if the step at hand is sound."""

    def __init__(
        self,
        config: dict[str, Any],
        param_groups: dict[str, list[nn.Parameter]],
        may_step: Callable[[Any], bool],
    ):
        """`may_step` is called with the gradient scaler after each backward pass."""
        super().__init__(config, param_groups)
        self._may_step = may_step

    def optimizer_scaler_step_some(self, grad_scaler: Any, param_groups: list[str]) -> None:
        """Step, or change nothing and drop all gradients. nerfstudio 1.1.5 calls no other way."""
        if self._may_step(grad_scaler):
            super().optimizer_scaler_step_some(grad_scaler, param_groups)
            return
        if grad_scaler.is_enabled():  # its update() insists on having seen the gradients
            for name in gradients_of(self.optimizers):
                grad_scaler.unscale_(self.optimizers[name])
        self.zero_grad_all()


class StepGuard:
    """Judges steps, and counts those that were skipped.

    It asks the pipeline's model for `losses` (the terms of the step at hand), `view_name()` and
    `drop_step()`, as far as the model has them.
    """

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

    def is_sound(self, step: int, model: Any, optimizers: Optimizers, grad_scaler: Any) -> bool:
        """Whether the optimizers may take `step`. If not it is said, and the model drops the step.

        With mixed precision, gradients overflow now and then, and the gradient scaler sees to them:
        then only losses are judged.
        """
        judged = {} if grad_scaler.is_enabled() else gradients_of(optimizers.optimizers)
        fault = find_fault(getattr(model, "losses", {}), judged)
        self.skipped_last = fault is not None
        if fault is None:
            return True
        self.skipped += 1
        view = f", in the photo {model.view_name()}" if hasattr(model, "view_name") else ""
        self._last = f"At step {step}{view}: {fault} is not finite"
        announce(
            f"{self._last}. The step is skipped ({self.skipped} of at most "
            f"{self.max_skipped}); nothing has changed.",
            warning=True,
        )
        if hasattr(model, "drop_step"):
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


@torch.no_grad()
def culled_always(splats: Splats) -> Bool[Tensor, " N"]:
    """Gaussians that no view shows: not `sound`, beyond the far plane, or too wide for any number.

    A backend culls them with a gradient of 0, so they never come back.
    """
    away = splats.means.abs().amax(-1) >= RenderSettings.far_plane
    return ~sound(splats) | away | (splats.scales.amax(-1) > TOO_WIDE)


def check_parameters(
    model: Any, optimizers: Optimizers, step: int, folder: Path, strict: bool
) -> None:
    """Refuse to save what no training can go on from; finite gradients do not rule it out.

    Gaussians may be culled, as long as most are not: each is a row of its own. All else (networks,
    embeddings, poses) must be finite.

    Args:
        folder: of the run's checkpoints.
        strict: nothing may be culled either: where the last step was skipped, that may be why.

    Raises:
        TrainingError: what is not finite, and which checkpoint is the newest.
    """
    lenient = not strict and hasattr(model, "gaussian_groups")
    per_gaussian = model.gaussian_groups() if lenient else set()
    bad = [
        name
        for name, optimizer in optimizers.optimizers.items()
        if name not in per_gaussian
        and not all(bool(p.isfinite().all()) for p in _parameters(optimizer))
    ]
    found = f"The parameters {', '.join(bad)} are not finite" if bad else None
    if found is None and hasattr(model, "culled_static"):
        found = too_many_culled(model.culled_static(), model.num_points)
    if found is None:
        return
    saved = checkpoints_in(folder) if folder.is_dir() else []
    newest = (
        f"The newest checkpoint, {saved[-1]}, is untouched: go on from it with "
        f"`--load-checkpoint {saved[-1]}`"
        if saved
        else "There is no earlier checkpoint: start anew"
    )
    raise TrainingError(
        f"{found} after step {step}, although every loss and gradient was. This state is not "
        f"saved. {newest}, and a lower --optimizers.GROUP.optimizer.lr."
    )


def too_many_culled(culled: int, count: int) -> str | None:
    """What is wrong where most static Gaussians are culled in every view; None if they are not."""
    if culled <= MAX_CULLED_SHARE * count:
        return None
    return f"{culled} of {count} static Gaussians hold values that no view can show"


def _parameters(optimizer: Optimizer) -> Iterator[Tensor]:
    for group in optimizer.param_groups:
        yield from group["params"]
