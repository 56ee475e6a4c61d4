"""Unpack an archive from elsewhere: files and folders only, below one folder, as many as fit.

Nothing of it is seen before all of it is there.
"""

from __future__ import annotations

import lzma
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import check_room

MOST_RATIO = 20
"""Photos hardly shrink in an archive: one that grows more often than this is none of photos."""

CHUNK = 1 << 20
"""Bytes."""

MAC = "__MACOSX"
"""What macOS puts beside the files of an archive."""

DAMAGE = (
    *(tarfile.TarError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError),
    *(RuntimeError, NotImplementedError),  # a password, or a way to pack that is not known
)
"""What reading an archive may raise."""


class Member(NamedTuple):
    """A file or a folder in an archive; neither is a link or a device."""

    name: str
    size: int
    is_folder: bool
    is_file: bool
    open: Callable[[], Any]
    """Gives the file to read from."""


def _in_tar(archive: tarfile.TarFile, info: tarfile.TarInfo) -> Member:
    opened = partial(archive.extractfile, info)
    return Member(info.name, info.size, info.isdir(), info.isreg(), opened)


def _in_zip(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Member:
    kind = info.external_attr >> 28  # of Unix: 8 is a file, 4 a folder, 0 is not said
    is_file = not info.is_dir() and kind in (0, 8)
    return Member(
        info.filename, info.file_size, info.is_dir(), is_file, partial(archive.open, info)
    )


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a `.zip`, or a `.tar` of any compression, into a folder, beside what is in it.

    Where all of it lies in one folder of this folder's name, that level is left out.

    Raises:
        CaptureError: it is damaged, it holds what may not be in it, or something of it is there
            already.
        ConfigError: the disk will not hold it.
    """
    unpacked = folder / f".{archive.name}.unpacking"
    shutil.rmtree(unpacked, ignore_errors=True)
    try:
        with _members(archive) as members:
            _check(archive, members, folder)
            for member in members:
                if PurePosixPath(member.name).parts[:1] != (MAC,):
                    _write(member, unpacked / member.name)
        _move_in(unpacked, folder)
    except DAMAGE as error:
        raise CaptureError(
            f"'{archive}' could not be unpacked ({error}). Remove it and fetch it again."
        ) from error
    finally:
        shutil.rmtree(unpacked, ignore_errors=True)


@contextmanager
def _members(archive: Path) -> Iterator[list[Member]]:
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as opened:
            yield [_in_zip(opened, info) for info in opened.infolist()]
    else:
        with tarfile.open(archive) as opened:
            yield [_in_tar(opened, info) for info in opened.getmembers()]
            while opened.fileobj and opened.fileobj.read(CHUNK):
                pass  # only behind its end are checksums compared


def _check(archive: Path, members: list[Member], folder: Path) -> None:
    for member in members:
        path = PurePosixPath(member.name)
        if path.is_absolute() or ".." in path.parts or "\\" in member.name or ":" in member.name:
            raise CaptureError(
                f"'{archive}' would write to '{member.name}', outside of '{folder}'. Nothing was "
                "unpacked. It is not the published data set: remove it."
            )
        if not (member.is_file or member.is_folder):
            raise CaptureError(
                f"'{member.name}' in '{archive}' is a link or a device. Nothing was unpacked. It "
                "is not the published data set: remove it."
            )
    size, packed = sum(member.size for member in members), archive.stat().st_size
    if size > MOST_RATIO * max(packed, CHUNK):
        raise CaptureError(
            f"'{archive}' has {packed / 1e6:.1f} MB and would become {size / 1e9:.1f} GB; photos "
            "hardly shrink in an archive. Nothing was unpacked. It is not the published data set: "
            "remove it."
        )
    folder.mkdir(parents=True, exist_ok=True)
    check_room(folder, size, f"unpacked '{archive.name}' has", "--folder")


def _write(member: Member, path: Path) -> None:
    """Write a file, of as many bytes as the archive said before."""
    if member.is_folder:
        path.mkdir(parents=True, exist_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    left = member.size
    with member.open() as source, path.open("wb") as target:
        while left > 0 and (chunk := source.read(min(left, CHUNK))):
            target.write(chunk)
            left -= len(chunk)
    if left > 0:
        raise EOFError(f"{left} bytes of '{member.name}' are missing")


def _move_in(unpacked: Path, folder: Path) -> None:
    inner = unpacked / folder.name
    source = inner if [*unpacked.iterdir()] == [inner] and inner.is_dir() else unpacked
    entries = [*source.iterdir()]
    for entry in entries:
        if (folder / entry.name).exists():
            raise CaptureError(
                f"'{folder / entry.name}' is there already. Move it away to have it unpacked anew."
            )
    for entry in entries:
        entry.rename(folder / entry.name)
