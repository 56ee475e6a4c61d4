"""The files of a trained run, found without importing torch: mistakes are told at once."""

from dataclasses import dataclass
from pathlib import Path

from desplat_ns.core.errors import CaptureError, CheckpointError, ConfigError

OURS = b"!!python/object:desplat_ns."
"""How the configuration of one of our runs begins."""

SURVEY = "survey.json"
"""In a run's folder: what its effects were decided by."""


@dataclass(frozen=True)
class RunFiles:
    """A run's config.yml and the folder of its checkpoints, which holds one at least."""

    config: Path
    checkpoints: Path
    data: Path | None = None
    """Folder of the capture, if it is not where it was trained on."""

    @property
    def folder(self) -> Path:
        return self.config.parent


def found(path: Path) -> Path:
    """A path of config.yml, or where nothing is there, its longest end that is there in the working
    folder: a run and its capture may have been moved together."""
    ends = (Path(*path.parts[first:]) for first in range(1, len(path.parts)))
    return path if path.exists() else next((end for end in ends if end.exists()), path)


OUTPUTS, DEPTH = Path("outputs"), 4
"""Where `ns-train` puts runs, and how far below it their folders are: experiment/method/time."""


def newest_run(path: Path) -> Path:
    """config.yml of the run that a path stands for: of a folder the run in or below it that was
    saved last, of a capture that of its name in `OUTPUTS`; else the path itself."""

    def saved(config: Path) -> float:
        checkpoints = config.parent.glob("[!.]*/step-*.ckpt")
        return max((path.stat().st_mtime for path in checkpoints), default=0.0)

    for place in (path, OUTPUTS / path.resolve().name):
        configs = [at for depth in range(DEPTH) for at in place.glob("*/" * depth + "config.yml")]
        if any(map(saved, configs)):
            return max(configs, key=saved)
    return path


def find_run(config: Path, data: Path | None = None) -> RunFiles:
    """The files of the run that a config.yml belongs to; checkpoints lie in a folder beside it,
    wherever the run's folder was moved.

    Args:
        data: as `RunFiles.data`.

    Raises:
        CaptureError: there is no such capture.
        ConfigError: there is no such file, or it is not of a run of this package.
        CheckpointError: the run saved no checkpoint.
    """
    if data is not None and not data.exists():
        raise CaptureError(f"There is no '{data}'. Name the folder of the run's capture by --data.")
    try:
        is_ours = config.is_file() and config.read_bytes().startswith(OURS)
    except OSError:
        is_ours = False
    if not is_ours:
        raise ConfigError(
            f"'{config}' is not the config.yml of a run of desplat, or cannot be read, and no run "
            "is below it. Give what `ns-train desplat` wrote: the folder "
            "outputs/<experiment>/<method>/<timestamp>, or one around it."
        )
    saved = sorted(config.parent.glob("[!.]*/step-*.ckpt"))
    if not saved:
        raise CheckpointError(
            f"The run of {config} has no checkpoint: no folder beside it holds a "
            "step-NNNNNNNNN.ckpt. Let the training end, or save earlier by --steps-per-save."
        )
    return RunFiles(config, saved[-1].parent.resolve(), data)
