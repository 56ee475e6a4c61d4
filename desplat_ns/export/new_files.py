"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from desplat_ns.errors import ConfigError


def check_new_file(path: Path, overwrite: bool) -> None:
    """Make sure that a file can be written, before minutes are spent on its content.

    Raises:
        ConfigError: it is there already, is a folder, or lies where nothing can be written.
    """
    if path.is_dir():
        raise ConfigError(f"--output is '{path}', which is a folder. Name a file in it.")
    if path.exists() and not overwrite:
        raise ConfigError(f"There is a '{path}' already. Name another, or add --overwrite.")
    _check_writable(path.parent)


def check_new_folder(path: Path, overwrite: bool) -> None:
    """As `check_new_file` for a folder; an empty one may be there."""
    if path.exists() and not path.is_dir():
        raise ConfigError(f"--output is '{path}', which is a file. Name a folder.")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise ConfigError(
            f"The folder '{path}' is not empty. Name another, or add --overwrite, which replaces "
            "files of the same name."
        )
    _check_writable(path.parent)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file beside its place and put it there when it is complete.

    Raises:
        ConfigError: it cannot be written.
    """
    with _beside(path) as folder:
        (folder / path.name).write_bytes(content)
        os.replace(folder / path.name, path)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """An empty folder to write into; what is in it is at `path` when all went well, else gone.

    Raises:
        ConfigError: something cannot be written.
    """
    with _beside(path) as folder:
        yield folder
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            place = path / file.relative_to(folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, place)


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A new folder on the same disk, removed in the end; an OSError within becomes ours."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        raise _unwritable(path, error) from error


def _check_writable(folder: Path) -> None:
    """Whether something can be made in a folder, or in the nearest that is there."""
    there = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not there.is_dir():
        raise ConfigError(f"'{there}' is a file; --output names something in it. Name a folder.")
    try:
        tempfile.TemporaryFile(dir=there).close()
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(path: Path, error: OSError) -> ConfigError:
    return ConfigError(
        f"'{path}' cannot be written ({error.strerror or error}). Name another place with --output."
    )
