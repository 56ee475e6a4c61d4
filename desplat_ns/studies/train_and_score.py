"""Train a run and score it in one process: what `ns-train` and then `ns-eval` do, started once.

python -m desplat_ns.studies.train_and_score RESULTS.json EVALUATIONS METHOD ...

The rest are options of ns-train.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from threading import Thread
from typing import Any

from nerfstudio.scripts.train import _set_random_seed

from desplat_ns.errors import DeSplatError
from desplat_ns.studies.curve import Curve, TrainingClock, scored_steps
from desplat_ns.studies.machine import code_version, device_name
from desplat_ns.studies.methods import parse

PICTURES = "pictures"
"""Folder beside the results, with the photos and the renderings beside them."""


def train_and_score(
    method: str, options: list[str], pictures: Path, evaluations: int = 1
) -> dict[str, Any]:
    """Figures, and what they are of.

    Args:
        method, options: see `methods.parse`.
        pictures: folder for the photos and the renderings beside them.
        evaluations: how often the run is scored, see `curve.scored_steps`.

    Returns:
        `figures` as `ns-eval` writes them, with `train_cpu_seconds` and `train_wall_seconds`, those
        of the training steps without reading photos, the last checkpoint and evaluation; `curve`,
        the same figures on the way and in the end, if there are several evaluations; `commit`,
        `device` and `backend`, see `runs.Record`; `device_name`.

    Raises:
        DeSplatError: training was stopped before its last step; such a model is not scored.
    """
    version, config = code_version(), parse(method, options)
    if config.data is not None:
        config.pipeline.datamanager.data = config.data
    _set_random_seed(config.machine.seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()

    def score(pictures: Path | None = None) -> dict[str, Any]:
        return trainer.pipeline.get_average_eval_image_metrics(
            step=trainer.step, output_path=pictures, get_std=True
        )

    wanted = config.max_num_iterations
    _ = trainer.pipeline.datamanager.cached_train  # photos: they would be read in the first step
    curve = Curve(TrainingClock(), score, scored_steps(wanted, evaluations))
    curve.attach(trainer)
    trainer.train()
    check_complete(trainer.step + 1, wanted)
    figures = score(pictures) | curve.seconds
    points = [*curve.points, {"step": wanted, **figures}] if evaluations > 1 else []
    return {
        "figures": figures,
        "curve": points,
        "commit": version,
        "device_name": device_name(str(trainer.device)),
        **where_of(figures),
    }


def where_of(figures: Mapping[str, Any]) -> dict[str, str | None]:
    """`device` and `backend` of a record, of the texts of an evaluation; None where one is
    missing."""
    device = figures.get("device")
    return {"device": device and device.partition(":")[0], "backend": figures.get("backend")}


def check_complete(done: int, wanted: int) -> None:
    """Refuse a training that was stopped: a stop signal lets it return as if it were done.

    Raises:
        DeSplatError: fewer steps are done than wanted.
    """
    if done < wanted:
        raise DeSplatError(
            f"Training stopped after {done} of {wanted} steps, so that there is nothing to record. "
            "Run the study again: it begins with what is missing."
        )


def end_with(parent: int) -> None:
    """End this process soon after its parent, so that nothing trains on for a study that was
    killed, into a folder in which another process begins again."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def main() -> None:
    """Entry point; pictures go into the folder `pictures` beside the results."""
    end_with(os.getppid())
    target, evaluations, method, *options = sys.argv[1:]
    pictures = Path(target).with_name(PICTURES)
    results = train_and_score(method, options, pictures, int(evaluations))
    Path(target).write_text(json.dumps(results))


if __name__ == "__main__":
    main()
