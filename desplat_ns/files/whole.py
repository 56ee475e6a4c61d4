"""Files that appear whole or not at all: written beside their place, put there when complete.

Checkpoints have their own way (`training.checkpoint_files`): theirs frees the disk first. Copies of
photos, thousands of them, are told by their last bytes (`process.photos`).
"""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from desplat_ns.errors import ConfigError


def check_new_file(path: Path, overwrite: bool, option: str = "--output") -> None:
    """Make sure that a file can be written, before minutes are spent on its content.

    Args:
        option: by which a user names it.

    Raises:
        ConfigError: it is there already, is a folder, or lies where nothing can be written.
    """
    if path.is_dir():
        raise ConfigError(f"{option} is '{path}', which is a folder. Name a file in it.")
    if path.exists() and not overwrite:
        raise ConfigError(f"There is a '{path}' already. Name another, or add --overwrite.")
    _check_writable(path.parent, option)


def check_new_folder(path: Path, overwrite: bool, option: str = "--output") -> None:
    """As `check_new_file` for a folder; an empty one may be there."""
    if path.exists() and not path.is_dir():
        raise ConfigError(f"{option} is '{path}', which is a file. Name a folder.")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise ConfigError(
            f"The folder '{path}' is not empty. Name another, or add --overwrite, which replaces "
            "files of the same name."
        )
    _check_writable(path.parent, option)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file; it outlives a power cut. Raises OSError where that cannot be done."""
    with draft_of(path) as draft, draft.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A place for a file's content; what is there is at `path` when all went well, else gone.

    Raises OSError where it cannot be put there.
    """
    with _beside(path) as folder:
        yield folder / path.name
        os.replace(folder / path.name, path)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """As `draft_of` for a folder: files in it, and in folders inside, are put beside those that are
    at `path` already."""
    with _beside(path) as folder:
        yield folder
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            place = path / file.relative_to(folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, place)


@contextmanager
def plain_errors(path: Path, option: str = "--output") -> Iterator[None]:
    """Within, an OSError becomes a ConfigError that says what to do."""
    try:
        yield
    except OSError as error:
        raise _unwritable(path, error, option) from error


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A new folder on the same disk, removed in the end."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _sigterm_raises():
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


class _Terminated(BaseException):
    """SIGTERM came."""


@contextmanager
def _sigterm_raises() -> Iterator[None]:
    """Within, SIGTERM ends the process once everything inside is left; by itself it leaves drafts.

    Nothing changes where something else answers the signal, as in training, and outside of the main
    thread, which alone gets signals.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def answer(*_: object) -> None:
        raise _Terminated

    signal.signal(signal.SIGTERM, answer)
    try:
        yield
    except _Terminated:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _check_writable(folder: Path, option: str) -> None:
    """Whether something can be made in a folder, or in the nearest that is there."""
    there = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not there.is_dir():
        raise ConfigError(f"'{there}' is a file; {option} names something in it. Name a folder.")
    with plain_errors(folder, option):
        tempfile.TemporaryFile(dir=there).close()


def _unwritable(path: Path, error: OSError, option: str) -> ConfigError:
    return ConfigError(
        f"'{path}' cannot be written ({error.strerror or error}). Name another place with {option}."
    )
