"""A run's folder: nothing in it is replaced, and what cannot be set up leaves none behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from desplat_ns.errors import ConfigError
from desplat_ns.training.checkpoint_files import checkpoints_in


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make a folder and those that it is in. If what is done within fails or is interrupted, those
    that were made are removed again, as far as they are empty; nothing else ever is.

    Raises:
        ConfigError: the folder cannot be made.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        _make(folder)
        yield
    except BaseException:
        for path in made:  # inner ones first; one that is not empty keeps those around it
            with suppress(OSError):
                path.rmdir()
        raise


def refuse_to_replace(checkpoints: Path, goes_on_from: Path | None) -> None:
    """Raise ConfigError where a run would replace the checkpoints of another.

    Args:
        checkpoints: the run's folder of checkpoints.
        goes_on_from: the checkpoint that the run starts from; in this folder it is the run's own.
    """
    if goes_on_from is not None and goes_on_from.resolve().parent == checkpoints.resolve():
        return
    saved = checkpoints_in(checkpoints) if checkpoints.is_dir() else []
    if saved:
        raise ConfigError(
            f"{saved[-1]} is of an earlier run, which this one would replace. Give another "
            "--timestamp, or leave it out for the time of day; --load-dir "
            f"{checkpoints} goes on with the earlier run."
        )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"The run's folder {folder} cannot be made ({error}). Name another place with "
            "--output-dir."
        ) from error
