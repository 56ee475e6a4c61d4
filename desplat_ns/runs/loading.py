"""A trained run, loaded, and which of its photos are shown: the one way of all commands.

Runs are shared, and nerfstudio 1.1.5 writes config.yml with PyYAML's tags of Python objects and
reads it by `yaml.Loader`, which imports, calls and fills whatever a tag names:
`!!python/object/apply:os.system [...]` is run. Here a tag counts only if a registered method or
data parser is written with it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from nerfstudio.configs.dataparser_configs import all_dataparsers
from nerfstudio.configs.method_configs import all_methods
from nerfstudio.utils import eval_utils

from desplat_ns.datamanager import without_prompts
from desplat_ns.errors import ConfigError
from desplat_ns.layouts.choices import OURS
from desplat_ns.pipeline import DeSplatPipeline, DeSplatPipelineConfig
from desplat_ns.run_config import RunConfig
from desplat_ns.runs.files import RunFiles

STANDARD = "tag:yaml.org,2002:"


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
    """Load a run as nerfstudio's `eval_setup` does, but for how config.yml is read.

    Args:
        change: of its configuration, before the pipeline is made.

    Raises:
        CaptureError: its capture cannot be read any more.
        CheckpointError: no checkpoint is intact, or they are not of this run.
        ConfigError: another version wrote config.yml, or it names what no run of ours does.
    """
    try:
        config = read_config(files.config)
        config.relative_model_dir = files.checkpoints
        if files.data is not None:
            config.pipeline.datamanager.data = files.data
        config = change(config)
        config.load_dir = config.get_checkpoint_dir()
        device = "cuda" if torch.cuda.is_available() else "cpu"
        pipeline: Any = config.pipeline.setup(device=torch.device(device), test_mode="test")
    except (yaml.YAMLError, AttributeError, KeyError) as error:
        raise ConfigError(
            f"'{files.config}' cannot be taken up ({str(error).partition(chr(10))[0]}): another "
            "version of this package, or of nerfstudio, wrote it. Use that version, or train anew."
        ) from error
    if not isinstance(pipeline, DeSplatPipeline):
        raise ConfigError(f"'{files.config}' is of a run with another pipeline than desplat's.")
    pipeline.eval()
    checkpoint, step = eval_utils.eval_load_checkpoint(config, pipeline)
    return LoadedRun(files, config, pipeline, checkpoint, step + 1)


def read_config(path: Path) -> Any:
    """What a config.yml holds.

    Raises:
        ConfigError: it names something else than what configures runs.
        OSError, yaml.YAMLError: it cannot be read.
    """

    class Loader(yaml.Loader):
        """Makes nothing of a node whose tag is not trusted."""

        def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
            if node.tag not in trusted_tags():
                raise ConfigError(
                    f"'{path}' names '{node.tag.removeprefix(STANDARD)}' in line "
                    f"{node.start_mark.line + 1}. Reading the file would run it, and no method or "
                    "data parser that is registered here needs it, so the file is not read. If "
                    "another version of this package, or of nerfstudio, wrote the file, use that "
                    "version, or train anew; if a plugin did, install it. Else do not use the file "
                    "unless you know who wrote it."
                )
            return super().construct_object(node, deep)

    return yaml.load(path.read_text("utf8"), Loader=Loader)


@cache
def trusted_tags() -> frozenset[str]:
    """The tags with which nerfstudio writes a run of a method with our pipeline and any registered
    data parser: kind and full name, such as `python/object:desplat_ns.model.DeSplatModelConfig`."""
    parsers: dict[str, Any] = {**OURS, **all_dataparsers}
    pipelines = ((method, getattr(method, "pipeline", None)) for method in all_methods.values())
    configs: list[Any] = [m for m, p in pipelines if isinstance(p, DeSplatPipelineConfig)]
    for name, parser in parsers.items():
        configs.append(parser)
        if name != "desplat-data":  # which looks for a capture
            with suppress(ConfigError):  # of a data parser that our data manager refuses
                configs.append(without_prompts(parser))
    written = yaml.dump(configs)
    tags = (getattr(event, "tag", None) for event in yaml.parse(written))
    return frozenset(filter(None, [*yaml.SafeLoader.yaml_constructors, *tags]))


def even_subset(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to `count` - 1, evenly spread, both ends among them."""
    if count <= most:
        return list(range(count))
    return [int(i) for i in np.unique(np.linspace(0, count - 1, most).round())] if most > 0 else []
