"""Train a run and score it in one process: what `ns-train` and then `ns-eval` do, started once.

python -m desplat_ns.tools.studies.train_and_score RESULTS.json METHOD OPTIONS OF ns-train
"""

import json
import os
import sys
import time
from pathlib import Path
from threading import Thread
from typing import Any

from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation
from nerfstudio.scripts.train import _set_random_seed

from desplat_ns.core.errors import DeSplatError
from desplat_ns.tools.studies.machine import code_version, device_name
from desplat_ns.tools.studies.methods import parse
from desplat_ns.tools.studies.runs import PICTURES


def train_and_score(method: str, options: list[str], pictures: Path) -> dict[str, Any]:
    """Train by a method and options of `ns-train`, score, and put pictures into a folder: `figures`
    as `ns-eval` writes them, with `train_cpu_seconds` and `train_wall_seconds` of the training
    steps, without photos, last checkpoint and evaluation; `commit`; `device_name`. Raises
    DeSplatError where training was stopped before its last step; such a model is not scored."""
    commit, config = code_version(), parse(method, options)
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
        raise DeSplatError(
            f"Training stopped after {trainer.step + 1} of {wanted} steps, so that there is "
            "nothing to record. Run the study again: it begins with what is missing."
        )
    figures = trainer.pipeline.get_average_eval_image_metrics(
        step=trainer.step, output_path=pictures, get_std=True
    )
    return {
        "figures": figures | seconds,
        "commit": commit,
        "device_name": device_name(str(trainer.device)),
    }


def end_with_study() -> None:
    """End this process when its stdin ends: nothing trains on for a study that was killed."""
    os.read(0, 1)  # sys.stdin would hold a lock that keeps Python from ending
    os._exit(1)


def main() -> None:
    """Entry point; pictures go into the folder `pictures` beside the results."""
    Thread(target=end_with_study, daemon=True).start()
    target, method, *options = sys.argv[1:]
    results = train_and_score(method, options, Path(target).with_name(PICTURES))
    Path(target).write_text(json.dumps(results))


if __name__ == "__main__":
    main()
