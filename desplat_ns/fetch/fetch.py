"""Fetch a data set: what is missing of it is downloaded and unpacked."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

from desplat_ns.console import announce, progress_with_time_left
from desplat_ns.errors import CaptureError
from desplat_ns.fetch.archives import unpack
from desplat_ns.fetch.download import download
from desplat_ns.fetch.sources import File, Source
from desplat_ns.files.whole import only_process_in


def fetch(source: Source, folder: Path, keep_archive: bool = False) -> list[Path]:
    """Download and unpack what is not there. What was begun is gone on with.

    Args:
        folder: the data set's own folder is made in it.
        keep_archive: whether archives stay once they are unpacked.

    Returns:
        The folders of its captures.

    Raises:
        CaptureError: see `download` and `unpack`; or there is no capture in it.
        ConfigError: nothing can be written there, the disk will not hold it, or another process is
            at work there.
    """
    home = folder / source.folder
    with only_process_in(home):
        for file in source.files:
            _fetch_file(file, home, keep_archive)
    if _is_capture(home):
        return [home]
    captures = [place for place in sorted(home.iterdir()) if _is_capture(place)]
    if not captures:
        raise CaptureError(
            f"There are no photos in '{home}': the data set is laid out in another way than it was "
            f"when this was written. Look at what is there, and at {source.page}."
        )
    return captures


def _is_capture(folder: Path) -> bool:
    return any((folder / name).is_dir() for name in ("images", "dense"))


def _fetch_file(file: File, home: Path, keep_archive: bool) -> None:
    target = home / Path(urlsplit(file.address).path).name
    mark = home / f".{target.name}.unpacked"
    if mark.exists() or (target.exists() and not file.is_archive):
        again = f" To have it unpacked anew: remove '{home}'." if mark.exists() else ""
        announce(f"{target.name} is there already.{again}")
        return
    if not target.exists():
        announce(f"Fetching {file.address}")
        with progress_with_time_left(f"{target.name}, MB") as bar:
            download(
                *(file.address, target),
                lambda done, total: bar(done // 10**6, max(done, total) // 10**6),
            )
    if file.is_archive:
        announce(f"Unpacking {target}, {target.stat().st_size / 1e9:.2f} GB")
        unpack(target, home)
        mark.touch()
        if not keep_archive:
            target.unlink()
