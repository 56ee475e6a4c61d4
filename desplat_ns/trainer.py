"""The training run: schedules of the run's length, checkpoints that survive, resume that resumes.

nerfstudio's loop does the training; here is only what it leaves open.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, cast

from nerfstudio.engine.optimizers import Optimizers
from nerfstudio.engine.trainer import Trainer
from nerfstudio.utils.decorators import check_main_thread
from nerfstudio.utils.misc import step_check

from desplat_ns.calibration.budgeted_run import BudgetedRun, process_started
from desplat_ns.console import announce
from desplat_ns.datamanager import DeSplatDataManagerConfig, training_split
from desplat_ns.errors import CaptureError, CheckpointError
from desplat_ns.gaussians.strategy import UNLIMITED
from desplat_ns.nerfstudio_quirks import train_on_where_logs_cannot_be_written
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.run_config import RunConfig, SavedRun
from desplat_ns.survey.survey import write_findings
from desplat_ns.training import resume
from desplat_ns.training.checkpoint_files import (
    checkpoint_path,
    remove_older,
    save_atomically,
)
from desplat_ns.training.optimizers import SHORT_RUN_GROUPS, raised_rates
from desplat_ns.training.run_folder import refuse_to_replace, run_folder
from desplat_ns.training.schedules import checked_schedules, follow, multiply_rates
from desplat_ns.training.step_guard import (
    GuardedOptimizers,
    StepGuard,
    check_parameters,
)
from desplat_ns.training.stop_signals import EndAtOnce, on_stop_signal


@dataclass
class DeSplatTrainerConfig(RunConfig):
    """Configuration of a training run; see `RunConfig`."""

    _target: type = field(default_factory=lambda: DeSplatTrainer)


class DeSplatTrainer(Trainer):
    """nerfstudio's Trainer with a clock, guarded steps, atomic checkpoints, exact resume.

    Ctrl+C, or SIGTERM, ends the run after the step at hand and saves; a second one ends it at once.
    """

    config: DeSplatTrainerConfig
    optimizers: GuardedOptimizers
    pipeline: DeSplatPipeline

    def __init__(
        self, config: DeSplatTrainerConfig, local_rank: int = 0, world_size: int = 1
    ) -> None:
        super().__init__(config, local_rank, world_size)
        train_on_where_logs_cannot_be_written()
        self._guard = StepGuard(config.max_skipped_steps)
        self._steps_done = 0
        self._loaded_from: Path | None = None
        self._saved: SavedRun | None = None
        self._saved_rng: dict[str, Any] | None = None
        self._waiting_in_viewer = self._stop_is_asked = False
        self._started = process_started()
        self._budgeted: BudgetedRun | None = None
        self._budget_is_up = False

    def setup(self, test_mode: Literal["test", "val", "inference"] = "val") -> None:
        """nerfstudio's, once it is decided which effects the run has. Whatever fails here leaves no
        folder behind.

        Raises:
            BackendUnavailableError: the backend cannot run on this machine's device.
            CaptureError: photos that cannot be surveyed.
            CheckpointError: one that cannot be gone on from.
            ConfigError: a budget in which nothing can be trained, or a folder that holds another
                run.
        """
        self._saved = self.config.saved_run()
        refuse_to_replace(self.checkpoint_dir, None if self._saved is None else self._saved[0])
        self._started += self.config.compile_kernels()  # no part of a budget
        manager = cast(DeSplatDataManagerConfig, self.config.pipeline.datamanager)
        capture = cache(partial(training_split, manager))
        findings = self.config.decide_effects(self._saved, capture)
        self.config.settle_length(capture)
        self._budgeted = self.config.plan_budget(self._saved, capture, self._started)
        with run_folder(self.base_dir):
            super().setup(test_mode)
            self.config.write_config()
        if findings is not None:
            write_findings(findings, self.base_dir)

    def setup_optimizers(self) -> Optimizers:
        """Optimizers whose learning rates go by the clock of the run, as the model does."""
        config, budget = self.config, self._budgeted
        model = self.pipeline.model
        if budget is not None:
            budget.attach(model)
        if model.clock.scale != 1.0:
            announce(f"Schedules are scaled by {model.clock.scale:g}, for this run's length.")
        steps = config.max_num_iterations if budget is None else budget.state.steps
        photos = len(self.pipeline.datamanager.train_image_names)
        raise_by = config.rate_factor(photos, steps)
        raised = raised_rates(config.optimizers, raise_by)
        groups = self.pipeline.get_param_groups()
        optimizers = GuardedOptimizers(
            checked_schedules(raised),
            groups,
            self._may_step,
            lambda: self.pipeline.model.view_optimizers(),
        )
        for scheduler in optimizers.schedulers.values():
            follow(scheduler, model.clock)
        early = config.early_rates(photos, raise_by, model.clock)
        if early is not None:
            multiply_rates(optimizers, SHORT_RUN_GROUPS, early)
        return optimizers

    def _may_step(self) -> bool:
        """Whether the step at hand is sound; too many that were not, and the run stops."""
        may = self._guard.is_finite(self.step, self.pipeline.model, self.optimizers)
        if self._guard.exhausted:
            self.stop_training = True
        return may

    def train(self) -> None:
        """Train until `max_num_iterations` steps are done in all, those of the checkpoint included.

        Where none is left it says so and changes nothing.

        Raises:
            CaptureError: a photo cannot be read any more; what is trained is saved before.
        """
        remaining = self.config.max_num_iterations - self._steps_done
        if self._budgeted is not None:  # by its clock, whatever had been planned
            remaining = UNLIMITED
        if remaining <= 0:
            self._say_nothing_is_left()
            return
        if self._saved_rng is not None:
            resume.restore_rng(self._saved_rng)
        whole = self.config
        # nerfstudio 1.1.5 trains as many steps *more*; only its loop is to see the smaller number
        self.config = copy.copy(whole)
        self.config.max_num_iterations = remaining
        try:
            with on_stop_signal(self._stop_after_this_step):
                super().train()
            for line in self.pipeline.model.found_in_the_way():
                announce(line)
        except CaptureError:
            self.stop_training = True
            self._after_train()
            raise
        finally:
            self.config = whole
            if self._budgeted is not None:
                whole.max_num_iterations = self._steps_done

    def train_iteration(self, step: int) -> Any:
        """One step; counts it as done once it is. Figures and rates are worked out where logged."""
        is_logged = step_check(step, self.config.logging.steps_per_log, run_at_zero=True)
        self.pipeline.model.is_logged = is_logged
        self.optimizers.is_logged = is_logged
        result = super().train_iteration(step)
        self._steps_done = step + 1
        if self._stop_is_asked:  # nerfstudio clears `stop_training` once its viewer is filled
            self.stop_training = True
        if self._budgeted is not None and self._budgeted.after_step(step):
            self.stop_training = self._budget_is_up = True
        return result

    def eval_iteration(self, step: int) -> None:
        """Evaluate where it is due, and leave the random generators as they were.

        So training does not depend on what is evaluated when, nor on what a metric draws when it
        is first built: a resumed run builds it at another step than one in one go. Where it fails,
        what is trained is saved before that ends the run.
        """
        config = self.config
        intervals = (config.steps_per_eval_batch, config.steps_per_eval_image)
        if not any(step_check(step, n) for n in (*intervals, config.steps_per_eval_all_images)):
            return
        state = resume.rng_state()
        try:
            super().eval_iteration(step)
        except CaptureError:  # `train` saves
            raise
        except Exception:
            resume.restore_rng(state)
            self.save_checkpoint(step)
            raise
        finally:
            resume.restore_rng(state)

    @check_main_thread
    def save_checkpoint(self, step: int) -> None:
        """Save the state after `step`, whole or not at all; only afterwards older ones go, but for
        the one before.

        Where it cannot be written on the way, that is said and training goes on: hours of it are
        worth more than one save. Raises CheckpointError where the run's last one cannot, and
        TrainingError where no training could go on from it.
        """
        path = checkpoint_path(self.checkpoint_dir, step)
        model, folder, skipped = self.pipeline.model, self.checkpoint_dir, self._guard.skipped_last
        check_parameters(model, self.optimizers, step, folder, skipped)
        try:
            save_atomically(self._state(step), path)
        except CheckpointError as error:
            if self.training_state == "completed":  # nerfstudio sets it before the last save
                raise
            every = self.config.steps_per_save
            announce(f"{error} Training goes on; the next try is in {every} steps.", warning=True)
            return
        if self.config.save_only_latest_checkpoint:
            remove_older(path)
        if self._budgeted is not None and self.training_state == "completed":
            self._budgeted.say_cost(step + 1)

    def _state(self, step: int) -> dict[str, Any]:
        """nerfstudio's checkpoint, and the keys `rng` and `sampler` that make resume exact."""
        state = {
            "step": step,
            "pipeline": self.pipeline.state_dict(),
            "optimizers": {k: v.state_dict() for k, v in self.optimizers.optimizers.items()},
            "schedulers": {k: v.state_dict() for k, v in self.optimizers.schedulers.items()},
            "scalers": self.grad_scaler.state_dict(),
            "rng": resume.rng_state(),
            "sampler": self.pipeline.datamanager.sampler_state(),
        }
        if self._budgeted is not None:
            state["budget"] = self._budgeted.saved(step + 1)
        return state

    def _load_checkpoint(self) -> None:
        """Go on from --load-checkpoint or --load-dir, if given. Raises CheckpointError."""
        saved, self._saved = self._saved, None
        if saved is None:
            announce("No checkpoint given: training from scratch.")
            return
        path, state = saved
        self.pipeline.load_pipeline(state["pipeline"], state["step"])
        resume.load_optimizers(self.optimizers, state["optimizers"], path)
        steps_done = state["step"] + 1
        if self.config.load_scheduler:
            resume.load_schedulers(self.optimizers, state.get("schedulers", {}), steps_done)
        self._load_randomness(state)
        if "budget" in state and self._budgeted is None:
            announce(
                "This run had a budget. Without --budget it goes on as one of "
                f"{self.config.max_num_iterations} steps.",
                warning=True,
            )
        self._start_step = self._steps_done = steps_done
        self._loaded_from = path
        announce(f"Going on from {path}, {steps_done} steps are done.")

    def _load_randomness(self, state: dict[str, Any]) -> None:
        """The order of the views now, the generators when training starts."""
        if "sampler" in state:
            self.pipeline.datamanager.load_sampler_state(state["sampler"])
        self._saved_rng = state.get("rng")

    def _say_nothing_is_left(self) -> None:
        announce(
            f"Nothing left to train: {self._loaded_from} has {self._steps_done} steps done "
            f"and --max-num-iterations, the total, is {self.config.max_num_iterations}. To train "
            "on, give a larger --max-num-iterations. To evaluate or render, use the config.yml of "
            "the run that wrote the checkpoint; nothing was saved for this one.",
            warning=True,
        )

    def _after_train(self) -> None:
        """Save and report; raise the guard's error if it stopped the run.

        A run stopped before a step has not done it, contrary to nerfstudio's count, which would
        then skip that step on resume; before the first there is nothing to save.
        """
        self.step = self._steps_done - 1
        if self._steps_done == 0:
            self.training_state = "completed"
            announce("Stopped before the first step: nothing to save.")
            return
        if self._guard.exhausted:
            self.training_state = "completed"
            self.save_checkpoint(self.step)
            raise self._guard.error(checkpoint_path(self.checkpoint_dir, self.step))
        if self._ran_to_its_end:  # of one that was stopped, going on must not tell the difference
            self.pipeline.model.sweep()
        super()._after_train()

    @property
    def _ran_to_its_end(self) -> bool:
        """Whether the run ended by itself: it was not told to stop."""
        return not self.stop_training or self._budget_is_up

    def _train_complete_viewer(self) -> None:
        """Keep the viewer open, unless the run was told to stop."""
        if self._ran_to_its_end:
            self._waiting_in_viewer = True
            super()._train_complete_viewer()

    def _stop_after_this_step(self, name: str) -> None:
        """What a stop signal does; once the viewer is kept open there is no step to wait for."""
        if self._waiting_in_viewer:
            raise EndAtOnce
        announce(f"Stopping after this step; {name} again to stop at once.", warning=True)
        self._stop_is_asked = self.stop_training = True
