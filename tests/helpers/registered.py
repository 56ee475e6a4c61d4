"""Short runs of methods, with every setting as registered."""

import copy
import random
from pathlib import Path
from typing import Any

import numpy as np
import torch
from nerfstudio.configs.method_configs import all_methods

from desplat_ns.core.checkpoint import load_newest
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from lab.synthetic import Scene, SceneSpec

STEPS = 120
"""The static scene has the first 24 to itself and is refined every fourth step of the first half;
then distractors are placed, refined when steps 40 and 80 are over, and placed no more from 108."""

EIGHT_VIEWS = SceneSpec(num_views=8, num_extras=2, width=72, height=48, num_points=300)
"""Five views have to see a place before anyone knows what is expected there."""


def registered_desplat(scene: Scene, output: Path, **changes: Any) -> Any:
    """As `registered`: of `ns-train desplat` on a generated scene."""
    assert scene.folder is not None
    return registered("desplat", RobustNerfDataParserConfig(data=scene.folder), output, **changes)


def registered(method: str, dataparser: Any, output: Path, **changes: Any) -> Any:
    """The configuration of `ns-train METHOD --max-num-iterations 120`.

    Nothing of the method is set but the length: data, folders, no viewer, no evaluation on the way;
    on the CPU.

    Args:
        changes: other fields of the trainer's configuration.
    """
    config: Any = copy.deepcopy(all_methods[method])
    config.pipeline.datamanager.dataparser = dataparser
    config.max_num_iterations, config.vis = STEPS, "tensorboard"
    config.steps_per_eval_image = config.steps_per_eval_all_images = STEPS + 1
    config.output_dir, config.experiment_name, config.timestamp = output, "eight", "run"
    config.machine.device_type = "cpu"
    for name, value in changes.items():
        setattr(config, name, value)
    return config


def set_up(config: Any, seed: int | None = None) -> Any:
    """nerfstudio's trainer, ready to train, as `ns-train` builds it."""
    for seeded in (random.seed, np.random.seed, torch.manual_seed):
        seeded(config.machine.seed if seed is None else seed)
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    return trainer


def last_state(config: Any) -> dict[str, Any]:
    """What a run's newest checkpoint holds, but for Python's generator: training draws from its own
    alone, and beartype, which checks shapes while tests run, draws from Python's."""
    state = load_newest(config.get_checkpoint_dir())[1]
    del state["rng"]["python"]
    return state
