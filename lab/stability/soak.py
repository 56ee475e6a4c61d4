"""A long run of small steps through the real trainer: does its memory stay flat?

    python -m lab.stability.soak            (--quick --output somewhere: a check only)

`ns-train desplat` on the generated scene of the tests, 30,000 steps on its own schedules:
distractors, densification, resets, and far more checkpoints and evaluations than usual. Writes
docs/records/soak.json.
"""

from __future__ import annotations

import copy
import gc
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from desplat_ns.studies.machine import describe_machine
from lab.arguments import parse_measurement, parser_of
from lab.documents import RECORDS
from lab.pixels.memory import status_mib

RECORD = "soak.json"
STEPS, EVERY = 30_000, 500
STEPS_PER_SAVE, STEPS_PER_EVAL = 100, 50

MOST_PER_STEP = 1.0
"""KiB. The scene has 300 to 500 Gaussians: one number for each of them, leaked once in a step, is
more than this; so is a checkpoint's state at every save, or an evaluation's pictures each time."""


@dataclass(frozen=True)
class Sample:
    """The process after some steps."""

    step: int
    rss: float
    """Resident memory, MiB."""
    objects: int
    """That Python's garbage collector knows of."""
    gaussians: int
    distractors: int
    ms_per_step: float
    """Wall time since the sample before, with its evaluations and checkpoints."""


@dataclass
class Soak:
    """What was recorded, and whether that is flat."""

    machine: dict[str, str]
    samples: list[Sample] = field(default_factory=list)

    @property
    def settled(self) -> list[Sample]:
        """The last two thirds of the run."""
        return [s for s in self.samples if 3 * s.step >= self.samples[-1].step]

    @property
    def slope(self) -> float:
        """Growth over the last two thirds, least squares, KiB per step."""
        steps = np.array([s.step for s in self.settled])
        rss = np.array([s.rss for s in self.settled])
        return float(np.polyfit(steps - steps.mean(), rss, 1)[0]) * 1024

    @property
    def growth(self) -> float:
        """Highest less first of the last two thirds, MiB."""
        return max(s.rss for s in self.settled) - self.settled[0].rss

    @property
    def most_growth(self) -> float:
        """MiB that `MOST_PER_STEP` would add up to over the last two thirds."""
        return MOST_PER_STEP * (self.settled[-1].step - self.settled[0].step) / 1024

    @property
    def flat(self) -> bool:
        return self.slope < MOST_PER_STEP and self.growth < self.most_growth


def watched_trainer(soak: Soak) -> type:
    """The trainer, which adds a sample to `soak` every `EVERY` steps."""
    from desplat_ns.trainer import DeSplatTrainer  # takes seconds: not for `--help`

    class Watched(DeSplatTrainer):
        last = time.perf_counter()

        def train_iteration(self, step: int) -> Any:
            result = super().train_iteration(step)
            if (step + 1) % EVERY == 0:
                now = time.perf_counter()
                soak.samples.append(sample(self, step + 1, 1e3 * (now - self.last) / EVERY))
                self.last = now
                print(json.dumps(asdict(soak.samples[-1])), flush=True)
            return result

    return Watched


def sample(trainer: Any, step: int, ms: float) -> Sample:
    model = trainer.pipeline.model
    distractors = sum(model.distractors.counts())
    return Sample(
        step, status_mib("VmRSS"), len(gc.get_objects()), model.num_points, distractors, ms
    )


def configured(scene: Path, output: Path, steps: int, trainer: type) -> Any:
    """`ns-train desplat` on a scene of `SceneSpec.tiny`."""
    from nerfstudio.configs.method_configs import all_methods

    from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
    from desplat_ns.settings.effects import EffectsConfig

    config: Any = copy.deepcopy(all_methods["desplat"])
    config._target = trainer
    config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(data=scene)
    model = config.pipeline.model
    model.effects = EffectsConfig()
    model.num_downscales, model.distractors.per_view = 0, 40
    # In pictures so small every Gaussian is wide enough to be split at each refinement, and pixels
    # weigh hundreds of times as much in a mean: 300 Gaussians would become 100,000 in 2,000 steps.
    model.split_screen_size, model.densify_grad_thresh = 1.0, 50 * model.densify_grad_thresh
    config.max_num_iterations, config.vis = steps, "tensorboard"
    config.steps_per_save, config.steps_per_eval_image = STEPS_PER_SAVE, STEPS_PER_EVAL
    config.output_dir, config.experiment_name, config.timestamp = output, "soak", "run"
    return config


def soaked(steps: int) -> Soak:
    """Train and watch. Raises OSError where the system does not tell memory (no Linux /proc)."""
    from nerfstudio.scripts import train

    from lab.synthetic import SceneSpec, write_scene

    soak = Soak(describe_machine())
    with tempfile.TemporaryDirectory() as folder:
        write_scene(SceneSpec.tiny(), Path(folder) / "scene")
        config = configured(Path(folder) / "scene", Path(folder), steps, watched_trainer(soak))
        train.main(config)
    return soak


def load(path: Path) -> Soak:
    """What `main` wrote."""
    saved = json.loads(path.read_text())
    return Soak(saved["machine"], [Sample(**s) for s in saved["samples"]])


def describe(soak: Soak) -> str:
    """The verdict in one line."""
    return (
        f"{soak.samples[-1].step:,} steps, {soak.settled[-1].rss:.0f} MiB: {soak.slope:+.3f} KiB "
        f"per step, {soak.growth:.1f} MiB above the first third's end; "
        f"{'flat' if soak.flat else 'NOT flat'} (less than {MOST_PER_STEP:g} KiB and "
        f"{soak.most_growth:.1f} MiB)"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    parser = parser_of("python -m lab.stability.soak", __doc__)
    chosen = parse_measurement(parser, RECORDS, arguments)
    soak = soaked(3 * EVERY if chosen.quick else STEPS)
    chosen.output.mkdir(parents=True, exist_ok=True)
    (chosen.output / RECORD).write_text(json.dumps(asdict(soak), indent=1) + "\n")
    print(describe(soak))


if __name__ == "__main__":
    main()
