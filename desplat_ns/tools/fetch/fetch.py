"""Fetch a data set: download what is missing, from where a download ended on, and unpack it."""

import shutil
import tarfile
import time
from collections.abc import Callable
from pathlib import Path

import requests

from desplat_ns.core.console import announce, progress_with_time_left
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.whole import check_room, only_process_in
from desplat_ns.tools.fetch.sources import Source

ATTEMPTS = 10
"""Connections that may break before it is given up; a call goes on where the last one ended."""
PATIENCE = 60
"""Seconds without a byte after which a connection counts as broken."""
MEGABYTE = 10**6


def fetch(source: Source, folder: Path) -> list[Path]:
    """Download and unpack what is not there into the data set's own folder, which is made in
    `folder`; the folders of its captures. What was begun is gone on with. Raises as `download` and
    `unpack`, CaptureError where there is no capture in it, ConfigError as `only_process_in`."""
    home = folder / source.folder
    with only_process_in(home):
        for address in source.files:
            _fetch_file(address, home)
    places = (home, *sorted(home.iterdir()))
    captures = [at for at in places if (at / "images").is_dir() or (at / "dense").is_dir()]
    if not captures:
        raise CaptureError(
            f"There are no photos in '{home}': the data set is laid out in another way than it was "
            f"when this was written. Look at what is there, and at {source.page}."
        )
    return captures[:1] if captures[0] == home else captures


def _fetch_file(address: str, home: Path) -> None:
    target = home / address.rpartition("/")[2]
    mark, is_archive = home / f".{target.name}.unpacked", target.suffix != ".tsv"
    if mark.exists() or (target.exists() and not is_archive):
        announce(f"{target.name} is there already. To have it anew: remove '{home}'.")
        return
    if not target.exists():
        announce(f"Fetching {address}")
        with progress_with_time_left(f"{target.name}, MB") as bar:
            download(address, target, bar)
    if is_archive:
        announce(f"Unpacking {target}, {target.stat().st_size / 1e9:.2f} GB")
        unpack(target, home)
        mark.touch()
        target.unlink()


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a `.zip`, or a `.tar` of any compression, into a folder, beside what is in it: nothing
    goes elsewhere, and nothing is seen before all of it is there. Where all of it lies in one
    folder of this folder's name, that level is left out. Raises CaptureError where it is damaged or
    would write elsewhere, the disk is full, or something of it is there already."""
    unpacked = folder / f".{archive.name}.unpacking"
    shutil.rmtree(unpacked, ignore_errors=True)
    try:
        try:
            _extract(archive, unpacked)
        except Exception as error:  # damage has many names, of several modules
            raise CaptureError(
                f"'{archive}' could not be unpacked ({error}). Make room, or fetch it anew."
            ) from error
        shutil.rmtree(unpacked / "__MACOSX", ignore_errors=True)
        inner = unpacked / folder.name
        source = inner if [*unpacked.iterdir()] == [inner] and inner.is_dir() else unpacked
        entries = [*source.iterdir()]
        if there := [folder / entry.name for entry in entries if (folder / entry.name).exists()]:
            raise CaptureError(
                f"'{there[0]}' is there already. Move it away to have it unpacked anew."
            )
        for entry in entries:
            entry.rename(folder / entry.name)
    finally:
        shutil.rmtree(unpacked, ignore_errors=True)


def _extract(archive: Path, folder: Path) -> None:
    """Unpack into a folder alone. Raises errors of many kinds."""
    if archive.suffix == ".zip":
        shutil.unpack_archive(archive, folder)  # leaves out names that lead elsewhere
        return
    with tarfile.open(archive) as file:
        if hasattr(tarfile, "data_filter"):
            file.extractall(folder, filter="data")
            return
        for member in file:  # Pythons before 3.11.4, as Debian 12's, have no filter
            is_inside = (folder / member.name).resolve().is_relative_to(folder.resolve())
            if not is_inside or not (member.isfile() or member.isdir()):
                raise tarfile.ExtractError(f"{member.name} is no file or folder inside of it")
        file.extractall(folder)


def download(address: str, target: Path, progress: Callable[[int, int], None]) -> None:
    """Fetch a file into a folder; until it is whole it is called `NAME.part`, and what is there of
    it is kept. `progress` takes megabytes that are there, and in all. Raises CaptureError where the
    server cannot be reached or has no such file, ConfigError where the disk will not hold it."""
    part = target.with_name(f"{target.name}.part")
    for attempt in range(1, ATTEMPTS + 1):
        try:
            _go_on(address, part, progress)
            break
        except OSError as error:  # requests' errors are such, too
            if attempt == ATTEMPTS:
                raise CaptureError(
                    f"{address} could not be fetched ({error}). What is there is kept: try again."
                ) from error
            time.sleep(attempt)
    part.replace(target)


def _go_on(address: str, part: Path, progress: Callable[[int, int], None]) -> None:
    """Fetch what is missing. Raises as `download`, or OSError."""
    have = part.stat().st_size if part.exists() else 0
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
    with requests.get(address, headers=headers, stream=True, timeout=PATIENCE) as answer:
        if address.startswith("https:") and not answer.url.startswith("https:"):
            raise CaptureError(f"{address} leads to {answer.url}, which is not encrypted.")
        if answer.status_code == 416:  # what is there is not a part of the file
            part.unlink()
        if answer.status_code in (416, 429) or answer.status_code >= 500:
            raise requests.ConnectionError(f"{answer.status_code} {answer.reason}")
        if answer.status_code >= 400:
            raise CaptureError(
                f"{address} answers {answer.status_code} {answer.reason}. The data set may have "
                "moved: look at its page, which desplat-fetch-data names."
            )
        have = have if answer.status_code == 206 else 0
        left = int(answer.headers.get("Content-Length", 0))
        check_room(part.parent, left, "what is to come has")
        with part.open("ab" if have else "wb") as file:
            # Raises where fewer bytes come than promised.
            for chunk in answer.iter_content(MEGABYTE):
                file.write(chunk)
                done = file.tell()
                progress(done // MEGABYTE, max(done, have + left) // MEGABYTE)
