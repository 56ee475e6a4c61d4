"""A training run with a budget of wall time: planned, kept to, saved and gone on from."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import psutil
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.calibration.run_plan import measure_costs, plan_run
from desplat_ns.console import announce
from desplat_ns.errors import ConfigError
from desplat_ns.model import DeSplatModel, DeSplatModelConfig
from desplat_ns.training.budget import END_SECONDS, BudgetClock, BudgetState

BYTES_A_SECOND = 100e6
"""At which a checkpoint is written, at least."""

STEPS_BETWEEN_CHECKS = 100
"""What a checkpoint will hold is counted so often: each view has parameters of its own. So often
it is also seen how many steps there will be."""

WORTH_SAYING = 0.1
"""Change of the number of steps since it was last said."""


def process_started() -> float:
    """When the command began, by the monotonic clock; now, if this is no command of its own."""
    is_command = Path(sys.argv[0]).stem.startswith("ns-train")
    age = time.time() - psutil.Process().create_time() if is_command else 0.0
    return time.monotonic() - max(0.0, age)


class BudgetedRun:
    """What a trainer asks where a run has a budget."""

    def __init__(
        self,
        budget: float,
        started: float,
        outputs: DataparserOutputs,
        model: DeSplatModelConfig,
        lengths: tuple[int, int],
        device: str,
        saved: dict[str, Any] | None,
    ):
        """Measure what a step costs here, and plan; settles the model's schedules and photo size.

        Args:
            budget: seconds of wall time.
            started: when the run began, by the monotonic clock.
            outputs: of the training split.
            model: effects decided; is changed.
            lengths: the most steps that are wanted, and the method's own number.
            device: on which the run trains.
            saved: `saved()` of the run's checkpoint, to go on; None for a new run.

        Raises:
            ConfigError: too few steps fit, or the run that is gone on from is over.
        """
        most, nominal = lengths
        self.budget, self._started = budget, started
        self.cost = measure_costs(outputs, model, device)
        num_views = len(outputs.cameras)
        if saved is None:
            self.state = plan_run(
                budget, self._seconds(), model, num_views, (most, nominal), self.cost
            )
        else:
            self.state = BudgetState(**saved["state"])
            self.state.most = max(self.state.most, most)
            self._check_unfinished(saved["steps_done"])
        model.train_downscale = self.state.downscale
        model.schedule_scale = scale = min(1.0, self.state.steps / nominal)
        run = model.for_run(num_views)
        costs = (self.cost.at(run, round(step / scale)) for step in range(self.state.steps))
        self.clock = BudgetClock(budget, self.state, costs, self._seconds, scale)
        self._said, self._checked = self.state.steps, (0, 0.0)
        self._say_plan(self.cost.mean(model, num_views, nominal))

    def _check_unfinished(self, steps_done: int) -> None:
        spent, reached = self.state.spent + self._seconds(), round(self.state.reached)
        if reached < self.state.steps and spent + END_SECONDS < self.budget:
            return
        raise ConfigError(
            f"There is nothing left to train: {spent:.0f} of {self.budget:.0f} s are spent, and "
            f"{steps_done} steps are done, {reached} of {self.state.steps} as they were planned. "
            "A run that was stopped goes on with a larger --budget (the total); one that came to "
            "its end has had its schedules: start a new one for more time."
        )

    def saved(self, steps_done: int) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"state": self.state.saved(), "steps_done": steps_done}

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _say_plan(self, a_step: float) -> None:
        smaller = self.state.downscale
        photos = "photos in full size" if smaller == 1 else f"photos {smaller} times smaller"
        announce(
            f"Budget: {self.budget:.0f} s, of which {self.clock.spent():.0f} are spent. A step is "
            f"expected to take {1e3 * a_step:.0f} ms on average: {self.state.steps} steps are "
            f"planned, {photos}. No evaluation on the way."
        )

    def attach(self, model: DeSplatModel) -> None:
        """Let the model that is trained go by this run's clock."""
        self._model = model
        model.clock = self.clock
        self._set_reserve()

    def after_step(self, step: int) -> bool:
        """Look at the clock; whether that was the last step that fits."""
        self.clock.after_step(step)
        if step % STEPS_BETWEEN_CHECKS == 0:
            self._set_reserve()
            self._say_change(step + 1)
        return self.clock.is_over(step + 1)

    def _say_change(self, done: int) -> None:
        """Say how many steps there will be, if that is another number than was said last."""
        state, (done_before, reached_before) = self.state, self._checked
        self._checked = done, state.reached
        planned_a_step = (state.reached - reached_before) / (done - done_before)
        if not planned_a_step > 0:
            return
        steps = min(state.most, done + round((state.steps - state.reached) / planned_a_step))
        if abs(steps / self._said - 1) >= WORTH_SAYING:
            announce(
                f"{done} steps in {self.clock.spent():.0f} s: there will be some {steps} in all, "
                f"not {self._said}."
            )
            self._said = steps

    def _set_reserve(self) -> None:
        self.clock.reserve = END_SECONDS + self._model.trained_bytes() / BYTES_A_SECOND

    def say_cost(self, steps_done: int) -> None:
        """What the run did cost."""
        spent = self.clock.spent()
        announce(
            f"Budget: {spent:.0f} of {self.budget:.0f} s were spent ({spent / self.budget:.0%}), "
            f"for {steps_done} steps; {self.state.steps} had been planned."
        )
