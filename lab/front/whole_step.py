"""One step of training as the trainer takes it, with all its bookkeeping, on a generated scene.

What a `ModelStep` leaves out: nn.Module.train, the guard, what is remembered, refinement and
placement (which are over at `SETTLED`), and that views take turns. Loading a photo and the log,
which nine of ten steps do without, are not in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import torch
from torch import nn
from torch.cuda.amp.grad_scaler import GradScaler

from desplat_ns.calibration.model_step import ModelStep, cameras_of
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.settings.effects import Effects
from desplat_ns.training.step_guard import GuardedOptimizers, StepGuard

SETTLED = 28_001
"""A step in which nothing is refined, placed, counted or looked at. What is done once in a round of
the views costs the same per step however many there are."""


@dataclass(frozen=True)
class Size:
    """What a step is measured on."""

    views: int
    static: int
    """Gaussians of the static scene."""
    width: int
    height: int
    distractors: int
    """Gaussians of each view that is drawn."""
    others: int | None = None
    """Gaussians of each other view; then only the first view is drawn. None: views take turns."""

    @property
    def pixels(self) -> int:
        """Of one photo."""
        return self.width * self.height

    @property
    def all_distractors(self) -> int:
        """Of all views."""
        others = self.distractors if self.others is None else self.others
        return self.distractors + (self.views - 1) * others


class WholeStep(ModelStep):
    """A step of a run whose sets are settled, of `desplat`'s kind."""

    optimizers: GuardedOptimizers

    def __init__(
        self,
        size: Size,
        like: Size | None = None,
        effects: Effects = Effects(distractors=True),  # noqa: B008  # frozen
    ) -> None:
        """Args:
        like: size of the scene whose Gaussians these resemble; by default this one's own.
        effects: without distractors, `size` has none.
        """
        self._guard = StepGuard(max_skipped=1)
        sized_for = None if like is None else (like.static, like.width, like.height)
        scene = make_scene(size.static, size.width, size.height, sized_for=sized_for)
        super().__init__(scene, effects, size.views, distractors_per_view=size.distractors)
        self._cameras = cameras_of(scene, size.views)
        if size.others is not None:
            self._spread_distractors(scene.view, size.others, range(1, size.views))
        self._cameras.metadata = {"train_idx": torch.arange(size.views)[:, None]}
        self._scaler = GradScaler(enabled=False)
        self._groups = [*self.optimizers.optimizers]
        self._in_turn = range(size.views if size.others is None else 1)
        self._steps = 0
        self.model.step, self.model.is_logged = SETTLED, False
        for view in range(size.views):  # all moments are there, as after a round
            self.step(view)

    def _optimizers_of(self, groups: dict[str, list[nn.Parameter]]) -> GuardedOptimizers:
        return GuardedOptimizers(
            self._options_of(groups), groups, self._may_step, self.model.view_optimizers
        )

    def _may_step(self) -> bool:
        return self._guard.is_finite(SETTLED, self.model, self.optimizers)

    def __call__(self) -> None:
        """The next view's step."""
        self.step(self._in_turn[self._steps % len(self._in_turn)])
        self._steps += 1

    def step(self, view: int) -> None:
        """One view's step, in nerfstudio's order."""
        model, batch = self.model, {"image": self.photo}
        model.train()
        self.optimizers.zero_grad_some(self._groups)
        outputs = model(self._cameras[view : view + 1])
        metrics = model.get_metrics_dict(outputs, batch)
        losses = model.get_loss_dict(outputs, batch, metrics)
        reduce(torch.add, losses.values()).backward()
        self.optimizers.optimizer_scaler_step_some(self._scaler, self._groups)
        model.step_post_backward(SETTLED)
