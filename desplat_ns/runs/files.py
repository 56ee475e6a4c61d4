"""The files of a trained run, found without importing torch: mistakes are told at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from desplat_ns.errors import CaptureError, CheckpointError, ConfigError

OURS = "tag:yaml.org,2002:python/object:desplat_ns."
"""How the tag of the configuration of one of our runs begins."""

SURVEY = "survey.json"
"""What `desplat_ns.survey.survey` writes into a run's folder."""

EVENTS = "events.out.tfevents.*"
"""TensorBoard's files."""


@dataclass(frozen=True)
class RunFiles:
    """A run's config.yml and the folder of its checkpoints, which holds one at least."""

    config: Path
    checkpoints: Path
    data: Path | None = None
    """Folder of the capture, if it is not where it was trained on."""

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.config.parent

    @property
    def events(self) -> list[Path]:
        """TensorBoard's files, oldest first; empty if the run recorded nothing."""
        return sorted(self.folder.glob(EVENTS))

    @property
    def survey(self) -> Path:
        """Where the survey's findings are, if there was a survey."""
        return self.folder / SURVEY


def find_run(config: Path, data: Path | None = None) -> RunFiles:
    """The files of the run that a config.yml belongs to.

    Checkpoints are looked for where the configuration says they are, then beside it: a run's
    folder may have been moved.

    Args:
        data: as `RunFiles.data`.

    Raises:
        CaptureError: there is no such capture.
        ConfigError: there is no such file, or it is not of a run of this package.
        CheckpointError: the run saved no checkpoint.
    """
    settings = _settings(config)
    if data is not None and not data.exists():
        raise CaptureError(f"There is no '{data}'. Name the folder of the run's capture by --data.")
    relative = _text(settings.get("relative_model_dir")) or "nerfstudio_models"
    names = [_text(settings.get(key)) for key in ("experiment_name", "method_name", "timestamp")]
    said = Path(_text(settings.get("output_dir")), *filter(None, names), relative)
    beside = config.parent / relative
    for folder in (said, beside):
        if any(folder.glob("step-*.ckpt")):
            return RunFiles(config, folder.resolve(), data)
    raise CheckpointError(
        f"The run of {config} has no checkpoint: neither {said} nor {beside} holds a "
        "step-NNNNNNNNN.ckpt. Let the training end, or save earlier by --steps-per-save; a run's "
        "folder that was copied needs its checkpoints beside config.yml."
    )


def _settings(config: Path) -> dict[str, yaml.Node]:
    """The top level of a config.yml, of which nothing is made."""
    try:
        root = yaml.compose(config.read_text("utf8"), Loader=yaml.SafeLoader)
        if isinstance(root, yaml.MappingNode) and root.tag.startswith(OURS):
            return {str(key.value): value for key, value in root.value}
        why = "it was not written by ns-train with a method of this package"
    except FileNotFoundError:
        why = "there is no such file"
    except (yaml.YAMLError, UnicodeDecodeError, OSError) as error:
        why = f"it cannot be read ({str(error).partition(chr(10))[0]})"
    raise ConfigError(
        f"'{config}' is not the config.yml of a run of desplat: {why}. Give the one that "
        "`ns-train desplat` wrote: outputs/<experiment>/<method>/<timestamp>/config.yml."
    )


def _text(node: yaml.Node | None) -> str:
    """A scalar, or a path, which nerfstudio writes as the list of its parts; "" for others."""
    if isinstance(node, yaml.SequenceNode):
        return str(Path(*(str(part.value) for part in node.value)))
    return str(node.value) if isinstance(node, yaml.ScalarNode) else ""
