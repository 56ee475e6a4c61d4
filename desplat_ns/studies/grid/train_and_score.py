"""Train a run and score it in one process: what `ns-train` and then `ns-eval` do, started once.

python -m desplat_ns.studies.grid.train_and_score RESULTS.json METHOD ...    (options of ns-train)
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import tyro
from nerfstudio.configs.method_configs import AnnotatedBaseConfigUnion
from nerfstudio.scripts.train import _set_random_seed


def train_and_score(arguments: list[str]) -> dict[str, Any]:
    """Results as `ns-eval` writes them, and `train_cpu_seconds`.

    Those are of the training steps, without start-up and evaluation.
    """
    config: Any = tyro.cli(AnnotatedBaseConfigUnion, args=arguments)
    if config.data is not None:
        config.pipeline.datamanager.data = config.data
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    started = time.process_time()
    trainer.train()
    seconds = time.process_time() - started
    results = trainer.pipeline.get_average_eval_image_metrics(step=trainer.step, get_std=True)
    return results | {"train_cpu_seconds": seconds}


def main() -> None:
    """Entry point."""
    target, *arguments = sys.argv[1:]
    Path(target).write_text(json.dumps(train_and_score(arguments)))


if __name__ == "__main__":
    main()
