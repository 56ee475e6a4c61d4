"""Settings of a training run, and what is settled of them before it starts: the length of its
schedules, its effects, its steps. config.yml then has them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs
from nerfstudio.engine.trainer import TrainerConfig

from desplat_ns.core.checkpoint import checkpoint_folder, load_checkpoint, load_newest
from desplat_ns.core.console import announce
from desplat_ns.core.effects import Effects
from desplat_ns.core.errors import ConfigError, begin_run
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.core.schedule import GPU_VISITS, seconds_of, steps_for_visits
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.plugin import check_what_is_read, write_enumerations_by_value
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.survey import decided_effects, mismatch_of, refuse_mismatch
from desplat_ns.training.datamanager import DeSplatDataManagerConfig
from desplat_ns.training.resume import SceneRecord

SavedRun = tuple[Path, dict[str, Any]]
"""A checkpoint's file and what it holds."""

Capture = Callable[[], DataparserOutputs]
"""Gives the training split, which is read only where something depends on it."""


@dataclass
class RunConfig(TrainerConfig):
    """Settings of a training run."""

    max_num_iterations: int = ranged(0, "[0, inf)")
    """Steps in all, resumed or not. 0: as many as show each photo `visits` times."""
    nominal_num_iterations: int = ranged(30000, "[1, inf)")
    """The method's own number of steps (B.3); shorter runs shrink every schedule by their ratio."""
    visits: float = ranged(0.0, "[0, inf)")
    """How often each photo is shown on a CPU, and twice as often on a GPU, where neither
    `max_num_iterations` nor a budget is given; more often where there are few photos
    (`steps_for_visits`). 0: the method's own number of steps, which is the most in any case."""
    full_rate_visits: float = ranged(0.0, "[0, inf)")
    """Visits of each photo, steps over photos, for which the learning rates are meant. A run with
    fewer visits multiplies the rates of the static Gaussians, by 4 at most; 0: they are as they are
    given."""
    settling: float = ranged(0.0, "[0, 1]")
    """Share of the run at its end in which the learning rates of the static Gaussians fall to 0."""
    accept_mismatch: bool = False
    """Train also where most photos show something else at the points than the others do, or masks
    leave nothing of most."""
    budget: str = ""
    """Wall time for the run, for example 10min: start-up, training and saving. Trial steps are
    timed, and decide how many there will be, at most `max_num_iterations`, and how large photos
    are; then their number follows the clock. Compiling kernels, once for each machine, is not
    counted.
    """

    def __new__(cls, *args: Any, **options: Any) -> "RunConfig":
        """Python's; PyYAML, which gives no options, reads what follows as `plugin` lets it."""
        if not args and not options:
            check_what_is_read()
        return super().__new__(cls)

    def print_to_terminal(self) -> None:
        """Name the run, in place of nerfstudio's hundreds of lines: config.yml has the settings."""
        data, config = self.pipeline.datamanager.data, self.get_base_dir() / "config.yml"
        announce(f"{self.method_name} trains on {data}. Its settings will be in {config}")

    def save_config(self) -> None:
        """Check what can be checked before ns-train starts any process; see `write_config`. Raises
        ConfigError where there would be several processes, or a number lies outside its range."""
        begin_run()
        check_ranges(self)
        check_ranges(self.pipeline.model, "--pipeline.model")
        if self.machine.num_devices * self.machine.num_machines > 1:
            raise ConfigError(
                "--machine.num-devices and --machine.num-machines ask for several processes; this "
                "method trains in one. Leave both at 1."
            )

    def write_config(self) -> None:
        """Write config.yml with all that was settled, paths absolute, once the run is set up: a
        command that fails before leaves nothing behind, and an earlier run's as it was."""
        write_enumerations_by_value()
        manager = self.pipeline.datamanager
        for config in (self, manager, getattr(manager, "dataparser", None)):
            for name in ("data", "output_dir", "load_dir", "load_checkpoint"):
                if isinstance(path := getattr(config, name, None), Path):
                    setattr(config, name, path.absolute())
        super().save_config()

    def setup(self, **kwargs: Any) -> Any:
        """Build the trainer, once the dataparser is recognised. Raises as `save_config`,
        `seconds_of` and `settle_dataparser`, and ConfigError where gradients would be scaled."""
        self.save_config()
        if self.budget:
            seconds_of(self.budget)
        if self.mixed_precision or self.use_grad_scaler:
            raise ConfigError(
                "--mixed-precision and --use-grad-scaler scale gradients, by which Gaussians are "
                "refined. Leave both at False."
            )
        if isinstance(self.pipeline.datamanager, DeSplatDataManagerConfig):
            self.pipeline.datamanager.settle_dataparser()
        return super().setup(**kwargs)

    def saved_run(self) -> SavedRun | None:
        """What --load-checkpoint or --load-dir names. Raises CheckpointError."""
        if self.load_dir is not None:
            folder = checkpoint_folder(self.load_dir, self.relative_model_dir)
            return load_newest(folder, self.load_step)
        if self.load_checkpoint is not None:
            return self.load_checkpoint, load_checkpoint(self.load_checkpoint)
        return None

    def decide_effects(self, saved: SavedRun | None, capture: Capture) -> Survey | None:
        """With `effects.auto` take those of the checkpoint that the run goes on from, or those that
        the capture calls for. Returns the survey's findings, if there was one. Raises CaptureError
        where photos cannot be surveyed, or most do not go with the points in a new run."""
        model = cast(DeSplatModelConfig, self.pipeline.model)
        findings = None
        if saved is not None and model.effects.auto:
            record = SceneRecord.from_state(saved[1]["pipeline"].get("_extra_state"))
            model.effects = model.effects.decided(Effects(**record.effects))
        elif model.effects.is_open:
            accept = self.accept_mismatch
            model.effects, findings = decided_effects(model.effects, capture(), accept)
        elif saved is None and not self.accept_mismatch:
            refuse_mismatch(mismatch_of(capture()))
        return findings

    def settle_length(self, capture: Capture) -> None:
        """Settle the number of steps, where none is given by what the photos ask for, or with a
        budget the method's own number; and the model's `schedule_scale`."""
        if self.max_num_iterations == 0 and self.visits > 0 and not self.budget:
            photos = len(capture().cameras)
            visits = self.visits * (1 if self.machine.device_type == "cpu" else GPU_VISITS)
            steps = steps_for_visits(visits, photos, self.nominal_num_iterations)
            self.max_num_iterations = steps
            announce(
                f"{steps} steps: {photos} photos, {steps / photos:.3g} visits of each. "
                "--max-num-iterations gives another number."
            )
        self.max_num_iterations = self.max_num_iterations or self.nominal_num_iterations
        model = cast(DeSplatModelConfig, self.pipeline.model)
        if model.schedule_scale is None:
            model.schedule_scale = min(1.0, self.max_num_iterations / self.nominal_num_iterations)
