"""Which files of a folder are photos, and files that must exist."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from desplat_ns.core.console import announce_once, list_names
from desplat_ns.core.errors import CaptureError

PHOTO_SUFFIXES = frozenset(
    (".jpg", ".jpeg", ".jpe", ".png", ".tif", ".tiff", ".webp", ".bmp", ".avif", ".heic", ".heif")
) | {".hif", ".jxl", ".jp2", ".j2k", ".exr", ".hdr", ".dpx", ".psd", ".tga", ".ppm", ".pgm"}
"""Endings of file names, in lower case."""

_FOLDERS: set[Path] = set()
"""Folders of photos of captures that were read."""


def is_photo(path: Path) -> bool:
    return path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith(".")


def photo_names(folder: Path) -> list[str]:
    """Of `file_names` the photos; empty if there is no such folder."""
    return [name for name in file_names(folder) if is_photo(Path(name))]


def begin_folder(folder: Path, names: Iterable[str]) -> None:
    """Note that a capture's photos are in a folder: they are exposed together. Says once how many
    of the files, paths below the folder, are no photos, which are passed over."""
    _FOLDERS.add(folder)
    shown = [name for name in names if not Path(name).name.startswith(".")]
    others = [Path(name).suffix.lower() for name in shown if not is_photo(Path(name))]
    if others:
        kinds = list_names(f"{n} {kind or 'without ending'}" for kind, n in Counter(others).items())
        announce_once(
            f"{len(shown) - len(others)} photos of {len(shown)} files in {folder}, {len(others)} "
            f"passed over: {kinds}."
        )


def exposed_together(path: Path) -> Path:
    """The folder of whose photos one exposure is found: of the capture, also for reduced copies
    beside it; else that of the photo."""
    for parent in path.parents:
        for folder in (parent, parent.parent / re.sub(r"_[\d.]+$", "", parent.name)):
            if folder in _FOLDERS and folder.is_dir():
                return folder
    return path.parent


def file_names(folder: Path) -> list[str]:
    """Files in a folder and the folders inside it, also behind links, sorted: paths below it with
    forward slashes."""
    names, seen = [], set()
    for at, folders, files in os.walk(folder, followlinks=True):
        if (real := os.path.realpath(at)) in seen:  # a link leads back
            folders.clear()
            continue
        seen.add(real)
        names += [Path(at, name).relative_to(folder).as_posix() for name in files]
    return sorted(names)


def photos_near(folder: Path) -> list[str]:
    """Photos in a folder and in those directly inside it, sorted, as paths below it."""
    paths = (path for pattern in ("*", "*/*") for path in folder.glob(pattern) if is_photo(path))
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def downscale_factors(images: Path) -> list[int]:
    """The N of folders such as `images_2`, `images_4` beside `images`, ascending."""
    copies = [path for path in images.parent.glob(f"{images.name}_*") if path.is_dir()]
    numbers = (path.name.removeprefix(f"{images.name}_") for path in copies)
    return sorted(int(number) for number in numbers if re.fullmatch(r"[1-9]\d*", number))


def check_files(paths: Sequence[Path], folder: Path, what: str, option: str) -> None:
    """Raise CaptureError, with `what` is missing from `folder` and the `option` to set, unless all
    files are there."""
    missing = [path for path in paths if not os.path.isfile(path)]  # also of names too long
    if missing:
        names = list_names(os.path.relpath(path, folder) for path in missing)
        raise CaptureError(
            f"{len(missing)} of {len(paths)} {what} that the capture names are not in {folder}: "
            f"{names}. Put them there, or name their folder with {option}."
        )
