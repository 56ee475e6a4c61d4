"""Folders of COLMAP models, text or binary: found, checked, and read with pycolmap."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401

from desplat_ns.errors import CaptureError

if TYPE_CHECKING:
    import pycolmap

USUAL_FOLDERS = (Path("sparse"), Path("colmap/sparse"), Path("sparse/0"), Path("colmap/sparse/0"))
"""Where reconstructions are looked for, in this order, unless the user names another folder."""


def find_models(data: Path, colmap_path: Path) -> list[Path]:
    """Folders of COLMAP models in a named or usual place; empty if there are none."""
    for folder in (data / place for place in places_of(colmap_path)):
        models = [folder] if _is_model(folder) else []
        if not models and folder.is_dir():
            models = [child for child in sorted(folder.iterdir()) if _is_model(child)]
        if models:
            return models
    return []


def places_of(colmap_path: Path) -> list[Path]:
    """Where a model is looked for, in this order, relative to the data."""
    others = USUAL_FOLDERS if colmap_path in USUAL_FOLDERS else ()
    return [colmap_path, *(place for place in others if place != colmap_path)]


def _is_model(folder: Path) -> bool:
    return _has_files(folder, "bin") or _has_files(folder, "txt")


def _has_files(folder: Path, kind: str) -> bool:
    parts = ("cameras", "images", "points3D")
    return all((folder / f"{part}.{kind}").is_file() for part in parts)


def state_of(folder: Path) -> tuple[tuple[str, int, int, int], ...]:
    """What changes with a file of a model: its time, size and place on the disk."""
    files = [(path.name, path.stat()) for path in sorted(folder.iterdir()) if path.is_file()]
    return tuple((name, s.st_mtime_ns, s.st_size, s.st_ino) for name, s in files)


def read_model(folder: Path) -> pycolmap.Reconstruction:
    """The whole model.

    Raises:
        CaptureError: damaged or missing files.
    """
    import pycolmap  # a quarter of a second: not for `--help`

    try:
        _check_points_file(folder / "points3D.bin")
        names = {} if _has_files(folder, "bin") else _names_in(folder / "images.txt")
        model = pycolmap.Reconstruction(folder)
        for number, name in names.items():
            model.image(number).name = name
        return model
    except (OSError, ValueError, LookupError, RuntimeError, MemoryError) as error:
        reason = str(error).strip().partition("\n")[0] or "damaged"
        raise CaptureError(
            f"The reconstruction {folder} cannot be read: {reason}. Mend it, copy it again or run "
            "COLMAP's mapper again; another one can be named with --colmap-path."
        ) from error


def _names_in(path: Path) -> dict[int, str]:
    """Photos' names by number; pycolmap 4.2.1 ends them at the first space, and where observations
    (an empty line, if there are none) do not follow each photo it passes over every second one.

    Raises:
        ValueError: they do not.
    """
    lines = [line for line in path.read_text("utf-8").split("\n") if not line.startswith("#")]
    names = {}
    for line, observations in zip(lines[::2], [*lines[1::2], ""], strict=False):
        if not line.strip():
            continue
        number, *_, name = line.split(maxsplit=9)
        if (last := observations.rsplit(maxsplit=1)) and not last[-1].lstrip("-").isdigit():
            raise ValueError(
                f"{path.name} needs two lines for each photo, the second with its observations or "
                f"empty, and {name.strip()} has none"
            )
        names[int(number)] = name.strip()
    return names


def _check_points_file(path: Path) -> None:
    """Make sure that a binary file of points holds as many as it says.

    pycolmap 4.2.1 believes the file's counts and goes on reading behind its end: a file that was
    copied in part keeps it busy for ever. A point has 51 bytes, of which the last 8 count the
    observations that follow, 8 bytes each.

    Raises:
        ValueError: it does not.
    """
    if not path.is_file():
        return
    data, end = path.read_bytes(), 8
    try:
        (count,) = struct.unpack_from("<Q", data)
        for _ in range(count):
            (observations,) = struct.unpack_from("<Q", data, end + 43)
            end += 51 + 8 * observations
    except (struct.error, OverflowError):
        end = -1
    if end != len(data):
        raise ValueError(f"{path.name} has {len(data)} bytes, which is not what its counts say")
