"""Points to start from, of a COLMAP model or of a PLY file.

Letters in shapes: P points, D distinct ones.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8

from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.core.errors import CaptureError

if TYPE_CHECKING:
    import pycolmap

RGB, SPLAT = ("red", "green", "blue"), ("f_dc_0", "f_dc_1", "f_dc_2")
COLORS = (RGB, tuple(f"diffuse_{name}" for name in RGB), ("r", "g", "b"), SPLAT)
"""What programs call colours in a PLY, in small letters; the last are 3DGS's zeroth harmonics."""


@dataclass(frozen=True)
class Points:
    """Triangulated points in the reconstruction's units, ordered by their ids."""

    xyz: Float[np.ndarray, "P 3"]
    rgb: UInt8[np.ndarray, "P 3"]
    """All black where nothing says the colours."""
    ids: Int[np.ndarray, " P"]
    """The reconstruction's own numbers of the points."""


NO_POINTS = Points(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.int64))


def points_of(model: "pycolmap.Reconstruction") -> Points:
    by_id = dict(sorted(model.points3D.items()))
    return Points(
        xyz=np.array([point.xyz for point in by_id.values()], dtype=np.float64).reshape(-1, 3),
        rgb=np.array([point.color for point in by_id.values()], dtype=np.uint8).reshape(-1, 3),
        ids=np.array(list(by_id), dtype=np.int64),
    )


def read_cloud(path: Path) -> Points:
    """The vertices of a PLY file, numbered from 1. Raises CaptureError where it cannot be read, or
    has no vertices with x, y and z."""
    from plyfile import PlyParseError

    try:
        columns = _vertices(path)
        xyz = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
    except (PlyParseError, OSError, ValueError, OverflowError, MemoryError) as error:
        raise CaptureError(
            f"The points of {path} cannot be read: {error}. Needed is a PLY file with x, y "
            "and z of each vertex. Write it or copy it again; a transforms.json without "
            "ply_file_path starts from random points."
        ) from error
    rgb = np.zeros(xyz.shape, np.uint8)
    for names in COLORS:
        if columns.keys() >= {*names}:
            colors = np.stack([columns[name] for name in names], axis=1)
            rgb = _in_8_bits((0.5 + C0 * colors).clip(0, 1) if names == SPLAT else colors)
            break
    return Points(xyz, rgb, np.arange(1, len(xyz) + 1))


def _vertices(path: Path) -> dict[str, np.ndarray]:
    """Columns of the first element that has x, y and z, by their names in small letters. Nothing
    behind it is read. Raises ValueError, OSError, PlyParseError.

    `PlyData.read` of plyfile 1.1.3 would go through faces one by one, and through vertices where
    they are text, and it refuses comments that are not ASCII.
    """
    from plyfile import PlyData, PlyListProperty

    with path.open("rb") as stream:
        head = SimpleNamespace(read=lambda n: stream.read(n).decode("ascii", "backslashreplace"))
        ply: Any = PlyData._parse_header(head)  # pyright: ignore[reportArgumentType]
        rows: Any = io.TextIOWrapper(stream, "latin-1") if ply.text else stream
        for element in ply:
            names = [known.name for known in element.properties]
            is_wanted = {"x", "y", "z"} <= {name.lower() for name in names}
            if is_wanted and element.count < 1:
                raise ValueError("it has no vertices")
            has_lists = any(isinstance(known, PlyListProperty) for known in element.properties)
            if is_wanted and ply.text and not has_lists:
                kind = [(name, float) for name in names]
                table = np.loadtxt(rows, kind, comments=None, max_rows=element.count, ndmin=1)
                if len(table) < element.count:
                    raise ValueError(f"{len(table)} rows for {element.count} vertices")
            else:
                element._read(rows, ply.text, ply.byte_order, "c")
                table = element.data
            if is_wanted:
                return {name.lower(): table[name] for name in names}
    raise ValueError("none of its elements has x, y and z")


def _in_8_bits(colors: Shaped[np.ndarray, "P 3"]) -> UInt8[np.ndarray, "P 3"]:
    """Colours go to 1 (of fractions, a tenth may be beyond), to 255, or to 65,535. Negative whole
    numbers are bytes, or pairs of bytes, of a type with a sign."""
    colors = np.nan_to_num(colors.astype(np.float64), posinf=0, neginf=0)
    has_fractions = (colors % 1).any()
    if colors.min() < 0 and not has_fractions:
        colors %= 256 if colors.min() >= -128 else 65536
    full = 255 if colors.max() <= 255 else 65535
    if colors.max() <= 1 or (has_fractions and np.quantile(colors, 0.9, method="lower") <= 2):
        full = 1
    return np.rint(colors * (255 / full)).clip(0, 255).astype(np.uint8)


def distinct(xyz: Float[np.ndarray, "P 3"]) -> Int[np.ndarray, " D"]:
    """Of points at one place the first one, in ascending order. One place is what eight steps of
    float32 at the scene's size hold: half of the points are nearer to their median than that."""
    if len(xyz) == 0:
        return np.zeros(0, np.int64)
    offsets = xyz.astype(np.float64) - np.median(xyz, axis=0)
    step = 8 * np.finfo(np.float32).eps * np.median(np.abs(offsets))
    cells = np.round(offsets / max(step, np.finfo(np.float32).tiny))
    order = np.lexsort(cells.T)  # keeps the order of equal ones; a third of np.unique's time
    is_first = np.append(True, (cells[order][1:] != cells[order][:-1]).any(axis=1))
    return np.sort(order[is_first])
