"""The training run: what nerfstudio's loop leaves open of schedules, checkpoints and resuming."""

import copy
import math
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from shlex import quote
from statistics import median
from typing import Any, Literal, cast

import psutil
import torch
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.engine.optimizers import Optimizers
from nerfstudio.engine.trainer import Trainer
from nerfstudio.utils import writer
from nerfstudio.utils.decorators import check_main_thread
from nerfstudio.utils.misc import step_check
from torch.optim.lr_scheduler import LambdaLR

from desplat_ns.backend.registry import compile_kernels
from desplat_ns.core.checkpoint import (
    checkpoint_path,
    checkpoints_in,
    refuse_to_replace,
    remove_older,
    run_folder,
    save_atomically,
    step_of,
)
from desplat_ns.core.console import TOLD_FROM, Telling, about, announce, says_what_is_next, telling
from desplat_ns.core.errors import CaptureError, CheckpointError, ConfigError
from desplat_ns.core.optimizers import follow, load_moments, optimizer_options, set_position
from desplat_ns.core.run_files import SURVEY
from desplat_ns.core.schedule import (
    RunStep,
    Schedule,
    early_rate_factor,
    rate_factor,
    seconds_of,
    settling_factor,
)
from desplat_ns.core.whole import plain_errors
from desplat_ns.plugin import train_on_where_logs_cannot_be_written
from desplat_ns.training import resume
from desplat_ns.training.clock import TIMED_FROM, Clock
from desplat_ns.training.datamanager import DeSplatDataManagerConfig, training_split
from desplat_ns.training.pipeline import DeSplatPipeline
from desplat_ns.training.preview import Preview
from desplat_ns.training.run_config import RunConfig, SavedRun
from desplat_ns.training.step_guard import GuardedOptimizers
from desplat_ns.training.stop_signals import on_stop_signal

MOST_UNSAVED = 300.0
"""Seconds of training that a kill may cost: `steps_per_save` may be an hour of large photos."""

STEPS_WANTED, FEWEST_STEPS = 500, 200
"""Steps that a budget has to hold for photos of full size, else their sides are halved; and to be
no error. Fewer where fewer are asked for."""

END_SECONDS = 3.0
"""Of a budget, reserved for the last checkpoint and the end of the process."""


@dataclass
class DeSplatTrainerConfig(RunConfig):
    """Configuration of a training run; see `RunConfig`."""

    _target: type = field(default_factory=lambda: DeSplatTrainer)


class DeSplatTrainer(Trainer):
    """nerfstudio's Trainer with a clock, guarded steps, atomic checkpoints and exact resume, which
    saves when it is told to stop."""

    config: DeSplatTrainerConfig
    optimizers: GuardedOptimizers
    pipeline: DeSplatPipeline

    def __init__(
        self, config: DeSplatTrainerConfig, local_rank: int = 0, world_size: int = 1
    ) -> None:
        super().__init__(config, local_rank, world_size)
        train_on_where_logs_cannot_be_written()
        self._steps_done = 0
        self._saved: SavedRun | None = None
        self._saved_rng: dict[str, Any] | None = None
        self._stop_is_asked = False
        self._started = process_started()
        self._plan: dict[str, int] = {}  # steps and size of photos of a run with a budget
        self._budget_is_up = False
        self._most = self.total = 0  # steps in all that are allowed, and aimed at
        self._prices: tuple[float, ...] = ()
        self._clock: Clock | None = None
        self._last_end = self._count_by = 0.0
        self._telling = Telling({})
        self._folder_lock = ExitStack()
        self._save_by = 0.0
        self.seconds_left: float | None = None  # as it was told last

    # --- before the first step ---------------------------------------------------------------

    def setup(self, test_mode: Literal["test", "val", "inference"] = "val") -> None:
        """nerfstudio's, once it is decided which effects the run has. Raises DeSplatError where
        backend, photos, checkpoint, budget or folder do not allow the run; no folder is left then.
        """
        config = self.config
        with ExitStack() as stack:
            stack.enter_context(run_folder(self.base_dir))
            self._saved = config.saved_run()
            refuse_to_replace(self.checkpoint_dir, None if self._saved is None else self._saved[0])
            self._started += compile_kernels(self._model_config.backend, config.machine.device_type)
            manager = cast(DeSplatDataManagerConfig, config.pipeline.datamanager)
            capture = cache(partial(training_split, manager))
            findings = config.decide_effects(self._saved, capture)
            config.settle_length(capture)
            self._most = self.total = config.max_num_iterations
            if config.budget and self._saved is not None:
                self._take_up_budget(*self._saved)
            super().setup(test_mode)
            after_step = [TrainingCallbackLocation.AFTER_TRAIN_ITERATION]
            self.preview = Preview(self.base_dir / "preview.html", self)
            self.callbacks.append(TrainingCallback(after_step, self.preview.after_step))
            if config.steps_per_save:
                self.callbacks.append(TrainingCallback(after_step, self._save_if_late))
            with plain_errors(self.base_dir, "--output-dir"):
                config.write_config()
                if findings is not None:
                    (self.base_dir / SURVEY).write_text(findings.to_json(), "utf8")
            self._folder_lock = stack.pop_all()  # held until the training is over

    @property
    def _model_config(self) -> Any:
        """The `DeSplatModelConfig` as it is before the model is made (`for_run`)."""
        return self.config.pipeline.model

    def setup_optimizers(self) -> Optimizers:
        """Optimizers whose learning rates go by the clock of the run, as the model does."""
        config, photos = self.config, len(self.pipeline.datamanager.train_image_names)
        ahead = config.max_num_iterations - (self._saved[1]["step"] + 1 if self._saved else 0)
        if not self._prices and (config.budget or ahead >= TIMED_FROM):
            each = 4 if config.budget else min(10, max(2, ahead // 100))
            self._prices = self._prices_of_steps(each)
        if config.budget and not self._plan:
            self._plan_budget()
        schedule = self.pipeline.model.schedule
        raised = rate_factor(photos, config.max_num_iterations, config.full_rate_visits)
        warmup, wanted = self._model_config.warmup_of(photos)

        steps = max(config.nominal_num_iterations, config.max_num_iterations)
        optimizers = self._guarded_optimizers(raised)
        follow(
            optimizers,
            schedule,
            early=lambda step: max(1.0, early_rate_factor(step, warmup, wanted) / raised),
            settling=lambda step: settling_factor(step, steps, config.settling),
        )
        return optimizers

    def _guarded_optimizers(self, raised_by: float = 1.0) -> GuardedOptimizers:
        options = optimizer_options(self.config.optimizers, raised_by)
        groups = self.pipeline.get_param_groups()
        return GuardedOptimizers(options, groups, lambda: self.pipeline.model)

    # --- time --------------------------------------------------------------------------------

    @property
    def _time_left(self) -> float:
        """Seconds of the budget in which steps can be done."""
        return seconds_of(self.config.budget) - END_SECONDS - self._seconds()

    def _plan_budget(self) -> None:
        """Settle how many steps of a new run fit into the budget, and with photos of which size.
        Raises ConfigError where they are too few."""
        most, least = self._most, self._model_config.train_downscale
        clock, steps = Clock(self.pipeline, *self._prices), 0
        for downscale in (least, 2 * least):
            config = self.pipeline.model.config
            self.pipeline.model.config = replace(config, train_downscale=downscale)
            steps = min(most, clock.steps_in(self._time_left, 0, most))
            if steps >= min(STEPS_WANTED, most):
                break
        if steps < (fewest := min(FEWEST_STEPS, most)):
            spent = self._seconds()
            enough = spent + END_SECONDS + 1.2 * fewest * clock.left(0, most) / most
            raise ConfigError(
                f"--budget is {self.config.budget}, of which {spent:.0f} s are spent: {steps} "
                f"steps fit, and a run needs {fewest}. Give {enough:.0f}s or more, or smaller "
                "photos (the data parser's --downscale-factor)."
            )
        self._settle(steps, downscale)
        self.pipeline.start_model_anew()

    def _take_up_budget(self, path: Path, state: dict[str, Any]) -> None:
        """Go on with the plan in a checkpoint, and count what was spent. Raises ConfigError where
        that run had no budget, or nothing is left of it."""
        if (saved := state.get("budget")) is None:
            raise ConfigError(
                f"The run of {path} had no --budget: give --max-num-iterations, the total of steps."
            )
        self._started -= saved["spent"]
        share = state.get("nominal", 0) / max(saved["steps"], self.config.nominal_num_iterations)
        if share >= 1 or self._time_left <= 0:
            raise ConfigError(
                f"There is nothing left to train: {self._seconds():.0f} s are spent of a --budget "
                f"of {self.config.budget}, and {share:.0%} of the schedules are done. A run that "
                "was stopped goes on with a larger --budget, the total."
            )
        self._prices = saved.get("prices", self._prices)
        self._settle(saved["steps"], saved["downscale"])

    def _settle(self, steps: int, downscale: int) -> None:
        """Give the run the length and the size of photos of a plan; config.yml has them then."""
        config, model = self.config, self._model_config
        self._plan = {"steps": steps, "downscale": downscale}
        config.max_num_iterations = self.total = steps
        model.train_downscale = downscale
        model.schedule_scale = min(1.0, steps / config.nominal_num_iterations)
        config.steps_per_eval_batch = config.steps_per_eval_image = 0
        config.steps_per_eval_all_images = 0
        size = "full size" if downscale == 1 else f"1/{downscale} of their size"
        announce(
            f"Budget: {config.budget}, of which {self._seconds():.0f} s are spent. Photos are "
            f"trained on in {size}. No evaluation on the way."
        )

    def _aim(self, clock: Clock, step: int) -> None:
        """Let the run, and its schedules, end with as many steps as fit into the time left."""
        schedule, at = self.pipeline.model.schedule, RunStep(step)
        fit = clock.steps_in(self._time_left, self._steps_done, self.total)
        self.total = min(self._most, fit)
        if self.total > self._steps_done:
            end = self._plan["steps"] / schedule.scale
            schedule.aim(at, schedule.nominal(at), self.total, end)

    @resume.rng_kept()
    def _prices_of_steps(self, each: int) -> tuple[float, float]:
        """Prices for a `Clock`, by medians of `each` steps on photos of the smallest and of the
        largest size that are coming. Another model trains, and nothing of the run changes."""
        pipeline, manager, kept = self.pipeline, self.pipeline.datamanager, self.pipeline.model
        order, pixels = manager.sampler_state(), manager.get_train_rays_per_batch()
        sizes = kept.config.downscale_factor
        last = sizes(self.config.nominal_num_iterations, pixels)
        first, step = max(sizes(0, pixels), 2 * last), kept.config.sh_degree
        timed: dict[float, list[float]] = {first: [], last: []}
        pipeline.start_model_anew()
        model: Any = pipeline.model
        model.schedule, model.config.sh_degree_interval = Schedule(), 1  # all harmonics
        self.optimizers = self._guarded_optimizers()
        self.optimizers.is_logged = pipeline.is_logged = False
        pipeline.train()
        for factor in (first, *each * [first], *each * [last]):
            began, model.config.downscale_factor = self._seconds(), lambda *_, now=factor: now
            model.step_cb(self.optimizers, step)
            super().train_iteration(step)
            model.step_post_backward(step)
            if self.device != "cpu":
                torch.cuda.synchronize()
            timed[factor].append(self._seconds() - began)
        pipeline._model = kept
        manager.load_sampler_state(order)
        small, whole = median(timed[first][1:]), median(timed[last])  # the first reads photos
        pixel = max(0.0, whole - small) / (pixels / last**2 - pixels / first**2)
        return max(0.0, whole - pixel * pixels / last**2), pixel

    def _tell_time(self, step: int, began: float) -> None:
        """Learn from a step that began at a time, and say what is left."""
        now, clock = self._seconds(), self._clock
        # what lies between two steps can be a pause, or an evaluation
        seconds, self._last_end = min(now - self._last_end, 3 * (now - began)), now
        if clock is None or step == self._start_step:  # which reads photos
            return
        clock.after_step(step, seconds)
        if self._plan and int(now) > int(now - seconds):  # once a second
            self._aim(clock, step)
        done, total = step + 1, self.total
        is_tenth = 10 * done // total > 10 * step // total
        if done < total and (is_tenth or int(now) > int(now - seconds)):
            left = None
            if is_tenth or now >= self._count_by:  # the clock asks every step that is left
                left = self.seconds_left = clock.left(done, total)
                self._count_by = now + TOLD_FROM
            line = f"Step {done:,} of {total:,}"
            self._telling.tell(line, None, left, is_whole=True, tenth=is_tenth)

    def _seconds(self) -> float:
        """Since the command began, without compiling; of a run that goes on all that is spent."""
        return time.monotonic() - self._started

    # --- the loop ----------------------------------------------------------------------------

    def train(self) -> None:
        """Train until `max_num_iterations` steps are done in all, those of the checkpoint included.
        Raises CaptureError where a photo cannot be read any more, once what is trained is saved."""
        whole = self.config
        most, done = self._most, self._steps_done
        if most <= done:
            announce(
                f"Nothing left to train: {done} steps are done and --max-num-iterations, the "
                f"total, is {most}. Give more to go on.",
                warning=True,
            )
            self._folder_lock.close()
            return
        if self._saved_rng is not None:
            resume.restore_rng(self._saved_rng)
        if self._prices:
            self._clock = Clock(self.pipeline, *self._prices)
            if self._plan:
                self._aim(self._clock, done)
            left = self.seconds_left = self._clock.left(done, self.total)
            steps = f"{self.total - done:,} steps"
            announce(f"{about(left).capitalize()} on this machine for {steps}.")
        self.preview.begin(done)
        # nerfstudio 1.1.5 trains as many steps *more*; only its loop is to see the smaller number
        self.config = copy.copy(whole)
        self.config.max_num_iterations = most - done
        self._save_by = time.monotonic() + MOST_UNSAVED
        try:
            with on_stop_signal(self._stop_after_this_step), telling() as (self._telling, _):
                self._telling.tell("Training", None, self.seconds_left, is_whole=True)
                super().train()
        except CaptureError:
            self.stop_training = True
            self._after_train()
            raise
        except KeyboardInterrupt:  # nerfstudio's commands end with 0 then, as if all were done
            announce(f"Ended at once. {self._how_to_go_on()}", warning=True)
            raise SystemExit(130) from None
        finally:
            self._folder_lock.close()
            self.config = whole
        if self.ran_to_its_end and not whole.viewer.quit_on_train_completion:
            with suppress(KeyboardInterrupt):
                self._train_complete_viewer()

    def train_iteration(self, step: int) -> Any:
        """One step; counts it as done once it is. Figures and rates are worked out where logged."""
        is_logged = step_check(step, self.config.logging.steps_per_log, run_at_zero=True)
        self.pipeline.is_logged = self.optimizers.is_logged = is_logged
        began = self._seconds()
        loss, terms, metrics = super().train_iteration(step)
        self._steps_done = step + 1
        self._tell_time(step, began)
        if self._stop_is_asked or self.optimizers.exhausted:
            self.stop_training = True  # nerfstudio clears it once its viewer is filled
        if self._plan and (self._steps_done >= self.total or self._time_left <= 0):
            self._budget_is_up = self.stop_training = True
        return loss.detach(), {name: term.detach() for name, term in terms.items()}, metrics

    def eval_iteration(self, step: int) -> None:
        """Evaluate the static scene, where it is due; random generators stay as they were, as a
        resumed run builds a metric, which may draw, at another step. If it fails, what is trained
        is saved before that ends the run."""
        config = self.config
        intervals = (config.steps_per_eval_batch, config.steps_per_eval_image)
        if not any(step_check(step, n) for n in (*intervals, config.steps_per_eval_all_images)):
            return
        try:
            with resume.rng_kept(), self.pipeline.static_scene():
                super().eval_iteration(step)
                self.preview.after_step(step, is_evaluated=True)
        except Exception:
            self.save_checkpoint(step)
            raise

    def _after_train(self) -> None:
        """Save and report, in place of nerfstudio's, which counts one step too many of a run that
        was stopped. Raises the guard's error if it stopped the run."""
        self.step, self.training_state = self._steps_done - 1, "completed"
        if self._steps_done == 0:
            announce("Stopped before the first step: nothing to save.")
            return
        self.save_checkpoint(self.step)
        if self.optimizers.exhausted:
            raise self.optimizers.error(checkpoint_path(self.checkpoint_dir, self.step))
        writer.write_out_storage()
        self.preview.end(self._steps_done)
        for callback in self.callbacks:
            callback.run_callback_at_location(self.step, TrainingCallbackLocation.AFTER_TRAIN)
        if not self.ran_to_its_end:
            announce(f"Stopped. {self._how_to_go_on()}")
            return
        model, config = self.pipeline.model, quote(str(self.base_dir / "config.yml"))
        announce(f"{self._steps_done} steps: {len(model.gauss_params['means'])} static Gaussians.")
        for line in model.found_in_the_way():
            announce(line)
        if not says_what_is_next():
            announce(f"Next: desplat-report --load-config {config}")
            announce(f"      desplat-export page --load-config {config} --output scene.html")

    def _how_to_go_on(self) -> str:
        saved = checkpoints_in(self.checkpoint_dir)
        if not saved:
            return "No checkpoint was saved."
        return (
            f"{step_of(saved[-1]) + 1} steps are saved. To go on, repeat the command with "
            f"--load-dir {quote(str(self.checkpoint_dir))}"
        )

    @property
    def ran_to_its_end(self) -> bool:
        """Whether the run ended by itself: it was not told to stop."""
        return not self.stop_training or self._budget_is_up

    def _stop_after_this_step(self, name: str) -> None:
        """What a stop signal does."""
        announce(f"Stopping after this step; {name} again to stop at once.", warning=True)
        self._stop_is_asked = self.stop_training = True

    # --- checkpoints -------------------------------------------------------------------------

    def _save_if_late(self, step: int) -> None:
        """Save after a step, the refinement that follows it included, if the last save is
        `MOST_UNSAVED` seconds ago."""
        if time.monotonic() >= self._save_by:
            self.save_checkpoint(step)

    @check_main_thread
    def save_checkpoint(self, step: int) -> None:
        """Save the state after `step`, whole or not at all, and then remove older ones but for one.
        One on the way that cannot be written is said; raises CheckpointError for the last one."""
        path, began = checkpoint_path(self.checkpoint_dir, step), time.monotonic()
        try:
            save_atomically(self._state(step), path)
        except CheckpointError as error:
            if self.training_state == "completed":  # nerfstudio sets it before the last save
                raise
            announce(f"{error} Training goes on, and tries again later.", warning=True)
            return
        finally:
            now = time.monotonic()
            self._save_by = now + max(MOST_UNSAVED, 50 * (now - began))  # saving takes 2% at most
        if self.config.save_only_latest_checkpoint:
            remove_older(path)

    def _state(self, step: int) -> dict[str, Any]:
        """What nerfstudio's commands read of a checkpoint, and what makes resume exact."""
        state = {
            "step": step,
            "nominal": self.pipeline.model.schedule.nominal(RunStep(step + 1)),
            "pipeline": self.pipeline.state_dict(),
            "optimizers": {k: v.state_dict() for k, v in self.optimizers.optimizers.items()},
            "rng": resume.rng_state(),
            "sampler": self.pipeline.datamanager.sampler_state(),
        }
        if self._plan:
            state["budget"] = {**self._plan, "spent": self._seconds(), "prices": self._prices}
        return state

    def _load_checkpoint(self) -> None:
        """Go on from --load-checkpoint or --load-dir, if given. Raises CheckpointError."""
        if self._saved is None:
            return
        (path, state), self._saved = self._saved, None
        done, total = RunStep(state["step"] + 1), self.config.max_num_iterations
        schedule = self.pipeline.model.schedule
        reached = state.get("nominal", schedule.nominal(done))
        if self._plan:
            end = total / schedule.scale
            self.total = done + math.ceil((end - reached) * schedule.scale)
            schedule.aim(done, reached, self.total, end)
        elif schedule.go_on(done, reached, total):
            announce(
                f"The run was planned for more steps. The {total - done} steps that are left go "
                "through the rest of its schedules."
            )
        self.pipeline.load_pipeline(state["pipeline"], state["step"])
        load_moments(self.optimizers, state["optimizers"])
        self._start_step = self._steps_done = done
        for scheduler in self.optimizers.schedulers.values():
            set_position(cast(LambdaLR, scheduler), self._steps_done)
        # the order of the views now, the generators when training starts
        self.pipeline.datamanager.load_sampler_state(state["sampler"])
        self._saved_rng = state["rng"]
        announce(f"Going on from {path}, {self._steps_done} steps are done.")


def process_started() -> float:
    """When the command began, by the monotonic clock; now, if this is no command of its own."""
    is_command = Path(sys.argv[0]).stem.startswith("ns-train")
    age = time.time() - psutil.Process().create_time() if is_command else 0.0
    return time.monotonic() - max(0.0, age)
