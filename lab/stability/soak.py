"""A long run of small steps through the real trainer: does its memory stay flat?

`ns-train desplat` on the generated scene of the tests, 30,000 steps on its own schedules, with
distractors, refinements and resets, an evaluation every 50 steps and a checkpoint every 100.
"""

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import psutil

STEPS, EVERY = 30_000, 500
MOST_PER_STEP = 1.0
"""KiB. The scene has 300 to 500 Gaussians: one number for each of them, leaked once in a step, is
more than this; so is a checkpoint's state at every save, or an evaluation's pictures each time."""


class Sample(NamedTuple):
    """The process after some steps."""

    step: int
    rss: float
    """Resident memory, MiB."""


def verdict(samples: list[Sample]) -> tuple[str, bool]:
    """How memory grew over the last two thirds of a run, and whether its highest sample there lies
    less than `MOST_PER_STEP` times these steps above the first one."""
    settled = [sample for sample in samples if 3 * sample.step >= samples[-1].step]
    growth = max(sample.rss for sample in settled) - settled[0].rss
    most = MOST_PER_STEP * (settled[-1].step - settled[0].step) / 1024
    text = (
        f"{samples[-1].step:,} steps, {samples[-1].rss:.0f} MiB at the end, at most {growth:.1f} "
        f"MiB above the first third's end: {'flat' if growth < most else 'NOT flat'} (less than "
        f"{most:.1f} MiB)."
    )
    return text, growth < most


def soaked(steps: int) -> list[Sample]:
    """Train, and look at the process every 500 steps."""
    from nerfstudio.scripts import train  # these take seconds: not for `--help`

    from desplat_ns.training.trainer import DeSplatTrainer
    from lab.stability.kills import configured
    from lab.synthetic import SceneSpec, write_scene

    samples: list[Sample] = []

    class Watched(DeSplatTrainer):
        def train_iteration(self, step: int) -> Any:
            result = super().train_iteration(step)
            if (step + 1) % EVERY == 0:
                rss = psutil.Process().memory_info().rss / 2**20
                samples.append(Sample(step + 1, rss))
                print(samples[-1], flush=True)
            return result

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scene(SceneSpec.tiny(), folder / "scene")
        config = configured(folder / "scene", folder, "soak", Watched)
        model = config.pipeline.model
        # In pictures so small every Gaussian is wide enough to be split at each refinement, and
        # pixels weigh hundreds of times as much in a mean: 300 Gaussians would become 100,000.
        model.split_screen_size, model.densify_grad_thresh = 1.0, 50 * model.densify_grad_thresh
        config.max_num_iterations, config.steps_per_save = steps, 100
        config.steps_per_eval_image = 50
        train.main(config)
    return samples


def measured() -> tuple[str, bool]:
    """As `verdict`, of the long run."""
    return verdict(soaked(STEPS))
