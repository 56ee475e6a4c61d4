"""Shared by the readers of captures: files that must exist, lists of photos, draws."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from desplat_ns.console import list_names
from desplat_ns.errors import CaptureError


def check_files(paths: Sequence[Path], folder: Path, what: str, option: str) -> None:
    """Make sure that all files are there.

    Raises:
        CaptureError: lists what is missing from `folder`, `what` it is, and the `option` to set.
    """
    missing = [path for path in paths if not path.is_file()]
    if not missing:
        return
    if not folder.is_dir():
        raise CaptureError(f"The {what} folder {folder} does not exist. Name it with {option}.")
    names = list_names(
        path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)
        for path in missing
    )
    raise CaptureError(
        f"{len(missing)} of {len(paths)} {what} that the capture names are not in {folder}: "
        f"{names}. Put them there, or name their folder with {option}."
    )


def find_photos(names: Sequence[str], wanted: Sequence[str]) -> list[list[int]]:
    """Indices of the photos that each entry means: the path inside the images folder or, where no
    path is so, the file name."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(PurePosixPath(name).name, []).append(i)
    places |= {name: [i] for i, name in enumerate(names)}
    return [places.get(entry, []) for entry in wanted]


def shuffled(keys: Iterable[str], seed: int) -> list[str]:
    """The keys in an order that depends on them and on `seed` alone."""
    ordered = sorted(keys)
    random.Random(seed).shuffle(ordered)
    return ordered
