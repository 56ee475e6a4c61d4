"""Folders of COLMAP models, text or binary: found, checked, and read with pycolmap."""

import shutil
import struct
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401

from desplat_ns.core.errors import CaptureError

if TYPE_CHECKING:
    import pycolmap

USUAL_FOLDERS = (Path("sparse"), Path("colmap/sparse"), Path("sparse/0"), Path("colmap/sparse/0"))
"""Where reconstructions are looked for, in this order, unless the user names another folder."""

UNEXPECTED = (OSError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError)
"""What contents that are not of the kind expected end in."""


def find_models(data: Path, colmap_path: Path) -> list[Path]:
    """Folders of COLMAP models in a named or usual place; empty if there are none."""
    for folder in (data / place for place in places_of(colmap_path)):
        if _kind_of(folder):
            return [folder]
        if models := [child for child in sorted(folder.glob("*")) if _kind_of(child)]:
            return models
    return []


def places_of(colmap_path: Path) -> list[Path]:
    """Where a model is looked for, in this order, relative to the data."""
    others = USUAL_FOLDERS if colmap_path in USUAL_FOLDERS else ()
    return [colmap_path, *(place for place in others if place != colmap_path)]


def _kind_of(folder: Path) -> str:
    """`bin` or `txt`; empty where a folder holds no model. Points may be a PLY, as programs of
    Gaussian splatting leave them."""
    for kind in ("bin", "txt"):
        points = any((folder / f"points3D.{end}").is_file() for end in (kind, "ply"))
        if points and all((folder / f"{part}.{kind}").is_file() for part in ("cameras", "images")):
            return kind
    return ""


def read_model(folder: Path) -> "pycolmap.Reconstruction":
    """The whole model, without points that stand in a PLY. Raises CaptureError where files are
    damaged or missing."""
    import pycolmap  # a quarter of a second: not for `--help`

    kind = _kind_of(folder)
    try:
        if kind == "bin":
            _check_counts(folder / "images.bin", 64, 24, is_named=True)
            _check_counts(folder / "points3D.bin", 43, 8)
            _check_counts(folder / "frames.bin", 64, 16, counted_by="<I")
        if not kind or (folder / f"points3D.{kind}").is_file():
            model = pycolmap.Reconstruction(folder)
        else:
            # The points stand in a PLY, and no photo observes them: the model's own file of points,
            # which pycolmap needs, is made with none in it.
            with TemporaryDirectory() as place:
                for path in folder.glob(f"*.{kind}"):
                    shutil.copy(path, place)
                Path(place, f"points3D.{kind}").write_bytes(bytes(8 * (kind == "bin")))
                model = pycolmap.Reconstruction(place)
        for number, name in _names_in(folder / "images.txt").items() if kind == "txt" else ():
            model.image(number).name = name
        return model
    except (*UNEXPECTED, RuntimeError, MemoryError) as error:
        reason = str(error).strip().partition("\n")[0] or "damaged"
        raise CaptureError(
            f"The reconstruction {folder} cannot be read: {reason}. Mend it, copy it again or run "
            "COLMAP's mapper again; another one can be named with --colmap-path."
        ) from error


def _names_in(path: Path) -> dict[int, str]:
    """Photos' names by number; pycolmap 4.2.1 ends them at the first space, and where observations
    (an empty line, if there are none) do not follow each photo it passes over every second one.

    Raises ValueError where they do not.
    """
    lines = [line for line in path.read_text("utf-8").split("\n") if not line.startswith("#")]
    observed = [line.split()[-1] for line in lines[1::2] if line.strip()]
    if not all(last.lstrip("-").isdigit() for last in observed):
        raise ValueError(
            f"{path.name} needs two lines for each photo, the second with its observations or empty"
        )
    photos = [line.split(maxsplit=9) for line in lines[::2] if line.strip()]
    return {int(number): name.strip() for number, *_, name in photos}


def _check_counts(
    path: Path, head: int, each: int, is_named: bool = False, counted_by: str = "<Q"
) -> None:
    """Make sure that a binary file holds as many entries as it says: `head` bytes, perhaps a name
    that ends in a zero, a number that counts what follows, and as often `each` bytes.

    pycolmap 4.2.1 believes the counts and goes on reading behind the file's end: a file that was
    copied in part keeps it busy, and takes memory, for ever, or crashes it. Raises ValueError.
    """
    if not path.is_file():
        return
    data, at = path.read_bytes(), 8
    try:
        (entries,) = struct.unpack_from("<Q", data)
        for _ in range(entries):
            at += head
            if is_named:
                at = data.index(b"\0", at) + 1
            (count,) = struct.unpack_from(counted_by, data, at)
            at += struct.calcsize(counted_by) + each * count
    except (struct.error, OverflowError, ValueError):
        at = -1
    if at != len(data):
        raise ValueError(f"{path.name} has {len(data)} bytes, which is not what its counts say")
