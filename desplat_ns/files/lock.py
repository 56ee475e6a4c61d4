"""A folder in which one process works at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout, UnixFileLock

from desplat_ns.errors import ConfigError

IN_USE = ".in-use"
"""Name of a folder's lock file. It holds the number of the process."""


@contextmanager
def only_process_in(folder: Path) -> Iterator[None]:
    """Within, no other process works in a folder, which is made; afterwards only what is in it is
    left. The operating system lets go of the lock however a process ends.

    Raises:
        ConfigError: another process is at work there, or nothing can be written there.
    """
    made = not folder.exists()
    try:
        with _held(folder / IN_USE):
            yield
    finally:
        if made:
            with suppress(OSError):
                folder.rmdir()  # where it is empty


@contextmanager
def _held(path: Path) -> Iterator[None]:
    lock, folder = FileLock(path, timeout=0), path.parent
    if folder.is_file():
        raise ConfigError(f"'{folder}' is a file. Name a folder.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise ConfigError(
            f"{_holder(path)} is at work in '{folder}'. Wait for its end, or name another folder."
        ) from error
    except OSError as error:
        raise ConfigError(
            f"Nothing can be written to '{folder}' ({error}). Name another folder."
        ) from error
    try:
        if type(lock) is UnixFileLock:  # the others keep marks of their own in it, or nobody may
            path.write_text(str(os.getpid()))
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # while it is held: filelock notices that a file is gone
        lock.release()


def _holder(path: Path) -> str:
    with suppress(OSError, ValueError):
        return f"Process {int(path.read_text())}"
    return "Another process"
