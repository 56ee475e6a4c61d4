"""A trained run, loaded, and which of its photos are shown: the one way of all commands."""

from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
import yaml
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig, DataparserOutputs
from nerfstudio.utils import eval_utils

from desplat_ns.core.checkpoint import load_newest
from desplat_ns.core.errors import ConfigError
from desplat_ns.core.run_files import RunFiles
from desplat_ns.plugin import RunLoader
from desplat_ns.training.pipeline import DeSplatPipeline
from desplat_ns.training.resume import SceneRecord
from desplat_ns.training.run_config import RunConfig


@dataclass(frozen=True)
class LoadedRun:
    """A run as its newest intact checkpoint has it."""

    files: RunFiles
    config: RunConfig
    pipeline: DeSplatPipeline
    checkpoint: Path
    steps: int
    """Done."""


def _remembered(record: SceneRecord) -> DataParserConfig:
    """What a checkpoint keeps of its capture: no photos, no points, no held-out views."""
    numbers: dict[str, Any] = dict(record.cameras or {})
    outputs = DataparserOutputs(
        image_filenames=[Path(name) for name in record.train_images],
        dataparser_transform=numbers.pop("transform"),
        dataparser_scale=float(numbers.pop("scale")),
        cameras=Cameras(**numbers),
    )
    parser: Any = SimpleNamespace(includes_time=False, get_dataparser_outputs=lambda **_: outputs)
    return DataParserConfig(lambda _: parser, Path())  # pyright: ignore[reportArgumentType]


def load_run(files: RunFiles, needs_photos: bool = True) -> LoadedRun:
    """Load a run as nerfstudio's `eval_setup` does. Without `needs_photos` the training cameras are
    the checkpoint's, if it has them, and the capture is not looked for. Raises CaptureError where
    that cannot be read any more, CheckpointError where no checkpoint is intact or of this run,
    ConfigError where another version wrote config.yml, or it names what no run needs."""
    try:
        config: Any = yaml.load(files.config.read_text("utf8"), Loader=RunLoader)
        config.relative_model_dir = files.checkpoints
        if files.data is not None:
            config.pipeline.datamanager.data = files.data
        config.load_dir = config.get_checkpoint_dir()
        device, mode = "cuda" if torch.cuda.is_available() else "cpu", "test"
        if not needs_photos:
            state = load_newest(files.checkpoints)[1]["pipeline"]
            record = SceneRecord.from_state(state.get("_extra_state"))
            if record.cameras:
                mode, manager = "inference", config.pipeline.datamanager
                manager.data, manager.dataparser = None, _remembered(record)
        pipeline: Any = config.pipeline.setup(device=torch.device(device), test_mode=mode)
    except (yaml.YAMLError, AttributeError, KeyError) as error:
        if isinstance(error, AttributeError) and not is_dataclass(error.obj):
            raise  # not of what config.yml holds
        raise ConfigError(
            f"'{files.config}' cannot be taken up ({str(error).partition(chr(10))[0]}): another "
            "version of this package, or of nerfstudio, wrote it. Use that version, or train anew."
        ) from error
    pipeline.eval()
    checkpoint, step = eval_utils.eval_load_checkpoint(config, pipeline)
    return LoadedRun(files, config, pipeline, checkpoint, step + 1)
