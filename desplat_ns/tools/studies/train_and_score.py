"""Train a run and score it: what `ns-train` and then `ns-eval` do."""

import time
from pathlib import Path
from typing import Any

from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.scripts.train import _set_random_seed
from nerfstudio.utils import writer

from desplat_ns.tools.studies.machine import device_name
from desplat_ns.tools.studies.methods import parse


def train_and_score(method: str, options: list[str], pictures: Path) -> tuple[dict[str, Any], str]:
    """Train by a method and options of `ns-train`, and score: figures as of `ns-eval`, with CPU and
    wall seconds of the training steps alone, and the device's name. Raises SystemExit where
    training was stopped before its last step; such a model is not scored."""
    for kept in (writer.EVENT_WRITERS, writer.EVENT_STORAGE, writer.GLOBAL_BUFFER):
        kept.clear()  # nerfstudio 1.1.5 keeps those of earlier runs
    config = parse(method, options)
    if config.data is not None:
        config.pipeline.datamanager.data = config.data
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    wanted, seconds = config.max_num_iterations, dict[str, float]()
    _ = trainer.pipeline.datamanager.cached_train  # photos: they would be read in the first step
    wall, cpu = time.perf_counter(), time.process_time()

    def stop_the_clock(step: int) -> None:
        seconds["train_cpu_seconds"] = round(time.process_time() - cpu, 2)
        seconds["train_wall_seconds"] = round(time.perf_counter() - wall, 2)

    place = [TrainingCallbackLocation.AFTER_TRAIN_ITERATION]
    trainer.callbacks.append(TrainingCallback(place, stop_the_clock, iters=(wanted - 1,)))
    trainer.train()
    if trainer.step + 1 < wanted:  # a stop signal lets it return as if it were done
        raise SystemExit(
            f"Training stopped after {trainer.step + 1} of {wanted} steps, so that there is "
            "nothing to record. Run the study again: it begins with what is missing."
        )
    figures = trainer.pipeline.get_average_eval_image_metrics(
        step=trainer.step, output_path=pictures, get_std=True
    )
    return figures | seconds, device_name(str(trainer.device))
