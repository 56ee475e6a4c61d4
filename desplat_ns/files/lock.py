"""A folder, or a file, on which one process works at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from desplat_ns.errors import ConfigError
from desplat_ns.files.whole import plain_errors

IN_USE = ".in-use"
"""Name of a folder's lock, and how that of a file ends. It holds the number of the process."""


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
def only_process_writing(file: Path) -> Iterator[None]:
    """As `only_process_in` for a file; others in its folder are free."""
    with _held(file.with_name(f".{file.name}{IN_USE}")):
        yield


@contextmanager
def _held(path: Path) -> Iterator[None]:
    lock, folder = FileLock(path, timeout=0), path.parent
    if folder.is_file():
        raise ConfigError(f"'{folder}' is a file. Name a folder.")
    with plain_errors(folder):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except Timeout as error:
            raise ConfigError(
                f"{_holder(path)} is at work in '{folder}'. Wait for its end, or name another "
                "folder."
            ) from error
    try:
        with suppress(OSError):  # Windows lets nobody write what is locked
            path.write_text(str(os.getpid()))
        yield
    finally:
        path.unlink(missing_ok=True)  # while it is held: filelock notices that a file is gone
        lock.release()


def _holder(path: Path) -> str:
    with suppress(OSError, ValueError):
        return f"Process {int(path.read_text())}"
    return "Another process"
