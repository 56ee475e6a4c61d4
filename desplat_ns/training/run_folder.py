"""A run's folder; what cannot be set up leaves no folder behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from desplat_ns.errors import ConfigError


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


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"The run's folder {folder} cannot be made ({error}). Name another place with "
            "--output-dir."
        ) from error
