"""A trained run, loaded, and which of its photos are shown: the one way of all commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import yaml
from nerfstudio.engine.trainer import TrainerConfig
from nerfstudio.utils.eval_utils import eval_setup

from desplat_ns.errors import ConfigError
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.run_config import RunConfig
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.trusted import check_trusted, other_version


@dataclass(frozen=True)
class LoadedRun:
    """A run as its newest intact checkpoint has it."""

    files: RunFiles
    config: RunConfig
    pipeline: DeSplatPipeline
    checkpoint: Path
    steps: int
    """Done."""


def load_run(
    files: RunFiles, change: Callable[[RunConfig], RunConfig] = lambda config: config
) -> LoadedRun:
    """Load a run as `ns-eval` does, once its config.yml is seen to name nothing foreign.

    Args:
        change: of its configuration, before the pipeline is made.

    Raises:
        CaptureError: its capture cannot be read any more.
        CheckpointError: no checkpoint is intact, or they are not of this run.
        ConfigError: another version wrote config.yml, or it names what no run of ours does.
    """

    def from_there(config: TrainerConfig) -> TrainerConfig:
        config.relative_model_dir = files.checkpoints
        return change(cast(RunConfig, config))

    check_trusted(files.config)
    try:
        config, pipeline, checkpoint, step = eval_setup(
            files.config, update_config_callback=from_there
        )
    except (yaml.YAMLError, ImportError, AttributeError, KeyError) as error:
        raise other_version(files.config, error) from error
    if not isinstance(pipeline, DeSplatPipeline):
        raise ConfigError(f"'{files.config}' is of a run with another pipeline than desplat's.")
    return LoadedRun(files, cast(RunConfig, config), pipeline, checkpoint, step + 1)


def even_subset(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to `count` - 1, evenly spread, both ends among them."""
    if count <= most:
        return list(range(count))
    return [int(i) for i in np.unique(np.linspace(0, count - 1, most).round())] if most > 0 else []
