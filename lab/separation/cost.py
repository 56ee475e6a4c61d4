"""What a step of `desplat` costs beside one of `desplat-paper`, step by step in one process.

DESPLAT_NS_DATA=<folder> python -m lab.separation.cost        (1,000 steps each, minutes)
"""

from __future__ import annotations

import argparse
import copy
import os
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import torch
from nerfstudio.engine.callbacks import TrainingCallbackLocation

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.method_configs import desplat, desplat_paper

BLOCK = 10
"""Steps of one method before the other has its turn: the machine's moods meet both."""


class Training:
    """One method's training, taken a step at a time."""

    def __init__(self, specification: Any, data: Path, steps: int, output: Path):
        config = copy.deepcopy(specification.config)
        config.pipeline.datamanager.dataparser = RobustNerfDataParserConfig(
            data=data, downscale_factor=2
        )
        config.max_num_iterations, config.vis, config.output_dir = steps, "tensorboard", output
        config.experiment_name, config.timestamp = config.method_name, "run"
        self.trainer: Any = config.setup(local_rank=0, world_size=1)
        self.trainer.setup()
        self.milliseconds: list[float] = []

    def step(self, step: int) -> None:
        """One step of nerfstudio's loop, timed in CPU milliseconds."""
        started = time.process_time()
        for location in TrainingCallbackLocation:
            if location is TrainingCallbackLocation.AFTER_TRAIN_ITERATION:
                self.trainer.train_iteration(step)
            if location is not TrainingCallbackLocation.AFTER_TRAIN:
                for callback in self.trainer.callbacks:
                    callback.run_callback_at_location(step, location=location)
        self.milliseconds.append(1000 * (time.process_time() - started))


def main() -> None:
    """Print medians over the whole run and over its last third, and their ratios."""
    parser = argparse.ArgumentParser(prog="python -m lab.separation.cost")
    parser.add_argument("--steps", type=int, default=1000, help="of each method (%(default)s)")
    steps = parser.parse_args().steps
    data = Path(os.environ["DESPLAT_NS_DATA"]) / "fox_cluttered"
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        runs = [Training(m, data, steps, Path(folder)) for m in (desplat, desplat_paper)]
        for first in range(0, steps, BLOCK):
            for run in runs:
                for step in range(first, min(first + BLOCK, steps)):
                    run.step(step)
    for name, part in (("all steps", slice(None)), ("last third", slice(-steps // 3, None))):
        ours, paper = (median(run.milliseconds[part]) for run in runs)
        print(f"{name}: desplat {ours:.1f}, desplat-paper {paper:.1f} CPU ms ({ours / paper:.2f})")
    for run in runs:
        model = run.trainer.pipeline.model
        print(
            f"{run.trainer.config.method_name}: {model.num_points:,} static, "
            f"{sum(model.distractors.counts()):,} distractor Gaussians"
        )


if __name__ == "__main__":
    main()
