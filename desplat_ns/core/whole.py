"""Files that appear whole or not at all: written beside their place, put there when complete. And
folders in which one process works at a time."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from desplat_ns.core.console import list_names
from desplat_ns.core.errors import ConfigError

IN_USE = ".in-use"
"""Name of a folder's lock file."""


def check_new_file(path: Path, overwrite: bool, option: str = "--output", ending: str = "") -> None:
    """Before minutes are spent on a file: raises ConfigError, which names the `option`, where it
    has another `ending`, is there already, is a folder, or lies where nothing can be written."""
    if not path.name.lower().endswith(ending):
        raise ConfigError(f"{option} is '{path}'; give it the ending {ending}.")
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


def check_room(folder: Path, needed: int, what: str) -> None:
    """Raises ConfigError where the disk of a folder, which is there, will not hold some bytes.
    `what` needs them, with a verb: "the runs need"."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise ConfigError(
            f"'{folder}' has room for {free / 1e9:.1f} GB, and {what} {needed / 1e9:.1f} GB. Make "
            "room, or name another folder."
        )


def write_whole(path: Path, content: bytes) -> None:
    """Write a file. Raises OSError where that cannot be done."""
    with draft_of(path) as draft:
        draft.write_bytes(content)


def write_output(path: Path, content: bytes, option: str = "--output") -> None:
    """As `write_whole`, for a file whose place a user gave by an `option`. Raises ConfigError."""
    with plain_errors(path, option):
        write_whole(path, content)


def check_ours(folder: Path, *names: str) -> None:
    """Raises ConfigError where a folder, which may be missing, holds anything but files and folders
    of these names and its lock."""
    there = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    if others := [name for name in there if name not in (IN_USE, *names)]:
        raise ConfigError(
            f"'{folder}' holds something else: {list_names(others, 5)}. Name a new or an empty "
            "folder."
        )


def begun_record(path: Path, begun: Mapping[str, Any]) -> dict[str, Any]:
    """What a command's record of its work in a folder says, an object of JSON with the names of
    `begun` at least; that itself, written, where the folder is empty. Raises ConfigError where the
    record is damaged, or the folder holds something else."""
    if not path.is_file():
        check_ours(path.parent)
        write_record(path, begun)
    try:
        record = json.loads(path.read_text("utf8"))
        if other := [n for n, value in begun.items() if type(record[n]) is not type(value)]:
            raise TypeError(f"{other[0]} is of another type")
    except (ValueError, LookupError, TypeError) as error:
        raise ConfigError(
            f"{path} is damaged ({error}). Name another folder, or remove '{path.parent}' to begin "
            "anew."
        ) from error
    return record


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record as `begun_record` reads it: names as they are, also those that are no text."""
    content = json.dumps(record, indent=1, ensure_ascii=False)
    write_whole(path, content.encode(errors="backslashreplace"))


@contextmanager
def draft_of(path: Path, staging: Path | None = None) -> Iterator[Path]:
    """A place for a file's content; what is there is at `path` when all went well, else gone.
    Raises OSError where it cannot be put there.

    Args:
        staging: the folder to write in, on the same disk, which no other process uses; what a kill
            left there goes first. Without it, a new one beside the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if staging is not None:
        shutil.rmtree(staging, ignore_errors=True)
        staging.mkdir()
    folder = staging or Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    try:
        yield folder / path.name
        _sync(folder / path.name)
        os.replace(folder / path.name, path)
        _sync(path.parent)  # what is in place outlives a power cut
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """As `draft_of` for a folder: files in it, and in folders inside, are put beside those that are
    at `path` already."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
        yield Path(folder)
        for file in [file for file in Path(folder).rglob("*") if file.is_file()]:
            place = path / file.relative_to(folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, place)


@contextmanager
def plain_errors(path: Path, option: str = "--output") -> Iterator[None]:
    """Within, an OSError becomes a ConfigError that says what to do."""
    try:
        yield
    except OSError as error:
        raise ConfigError(
            f"'{path}' cannot be written ({error.strerror or error}). Name another place with "
            f"{option}."
        ) from error


@contextmanager
def only_process_in(folder: Path) -> Iterator[None]:
    """Within, no other process works in a folder, which is made with those that it is in; of these
    the ones that are left empty go again. The lock ends with the process, however that ends. Raises
    ConfigError where another one is at work, or nothing can be written."""
    path, made = folder / IN_USE, [at for at in (folder, *folder.parents) if not at.exists()]
    lock = FileLock(path, timeout=0)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
            path.write_text("in use\n")  # a full disk is told at once
        except Timeout as error:
            raise ConfigError(
                f"Another process is at work in '{folder}'. Wait for its end, or name another "
                "folder."
            ) from error
        except OSError as error:
            raise ConfigError(
                f"Nothing can be written to '{folder}' ({error}). Name another folder."
            ) from error
        yield
    finally:
        if lock.is_locked:
            with suppress(OSError):
                path.unlink()  # while it is held: filelock notices that a file is gone
        lock.release()
        for at in made:  # inner ones first; one that is not empty keeps those around it
            with suppress(OSError):
                at.rmdir()


def _sync(path: Path) -> None:
    """Wait until a file, or a renaming in a folder, is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _check_writable(folder: Path, option: str) -> None:
    """Whether something can be made in a folder, or in the nearest around it that is there."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    with plain_errors(folder, option):
        tempfile.TemporaryFile(dir=there).close()
