"""COLMAP reconstructions, text or binary, read with pycolmap and checked.

Letters in shapes: P points.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
from jaxtyping import Float, Int, UInt8
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.console import announce_once
from desplat_ns.data.checks import LARGEST_SIDE
from desplat_ns.errors import CaptureError

if TYPE_CHECKING:
    import pycolmap

CAMERA_TYPES = {
    "SIMPLE_PINHOLE": CameraType.PERSPECTIVE,
    "PINHOLE": CameraType.PERSPECTIVE,
    "SIMPLE_RADIAL": CameraType.PERSPECTIVE,
    "RADIAL": CameraType.PERSPECTIVE,
    "OPENCV": CameraType.PERSPECTIVE,
    "OPENCV_FISHEYE": CameraType.FISHEYE,
    "SIMPLE_RADIAL_FISHEYE": CameraType.FISHEYE,
    "RADIAL_FISHEYE": CameraType.FISHEYE,
}
"""COLMAP's camera models that nerfstudio can undistort."""

USUAL_FOLDERS = (Path("sparse"), Path("colmap/sparse"), Path("sparse/0"), Path("colmap/sparse/0"))
"""Where reconstructions are looked for, in this order, unless the user names another folder."""


@dataclass(frozen=True)
class Frame:
    """One photo with a known pose."""

    name: str
    """Path inside the images folder, with forward slashes."""
    image_id: int
    world_to_camera: Float[np.ndarray, "3 4"]
    """COLMAP's pose: OpenCV axes, the reconstruction's own units."""
    camera_type: CameraType
    width: int
    height: int
    intrinsics: dict[str, float]
    """fx, fy, cx, cy in pixels; k1 .. k4, p1, p2 where the model has them."""


@dataclass(frozen=True)
class Points:
    """Triangulated points in the reconstruction's units, ordered by their ids."""

    xyz: Float[np.ndarray, "P 3"]
    rgb: UInt8[np.ndarray, "P 3"]
    ids: Int[np.ndarray, " P"]
    """The reconstruction's own numbers of the points."""


@dataclass(frozen=True)
class Reconstruction:
    """What is used of a COLMAP model."""

    folder: Path
    frames: list[Frame]
    """Photos with a pose, ordered by image id (nerfstudio's order)."""
    points: Points


def read_reconstruction(data: Path, colmap_path: Path) -> Reconstruction:
    """Read the reconstruction of a capture; of several models, the one with most photos.

    The one that was read last is kept, and given again as long as its files are the same: do not
    change what it holds.

    Args:
        data: the capture's folder.
        colmap_path: a model's folder or a folder of models, relative to `data`. The usual places
            (`sparse`, `sparse/0`, `colmap/sparse/0`) stand in for each other.

    Raises:
        CaptureError: nothing there, damaged files, cameras or poses that cannot be used.
    """
    if not data.is_dir():
        raise CaptureError(f"The folder {data} does not exist. Give the capture's with --data.")
    folders = find_models(data, colmap_path)
    if not folders:
        raise CaptureError(
            f"No COLMAP reconstruction in {data} (looked in "
            f"{', '.join(map(str, _places(colmap_path)))}). Needed: a folder with cameras, images "
            "and points3D as .bin or .txt. Run COLMAP first, or name the folder with "
            "--colmap-path, relative to --data."
        )
    return _largest(tuple(folders), tuple(map(_state_of, folders)))


def _state_of(folder: Path) -> tuple[tuple[str, int, int, int], ...]:
    """What changes with a file of a model: its time, size and place on the disk."""
    files = [(path.name, path.stat()) for path in sorted(folder.iterdir()) if path.is_file()]
    return tuple((name, s.st_mtime_ns, s.st_size, s.st_ino) for name, s in files)


@lru_cache(maxsize=1)
def _largest(folders: tuple[Path, ...], _states: tuple[Any, ...]) -> Reconstruction:
    """The model with most photos; read anew where a file is in another state."""
    models = [(folder, _read_model(folder)) for folder in folders]
    folder, model = max(models, key=lambda entry: entry[1].num_reg_images())
    if len(models) > 1:
        others = ", ".join(f"{f.name}: {m.num_reg_images()}" for f, m in models if f != folder)
        announce_once(
            f"Reconstruction: {folder} with {model.num_reg_images()} photos, the largest of "
            f"{len(models)} (photos in the others: {others})."
        )
    frames = [_frame(image, folder) for image in _registered(model)]
    if not frames:
        raise CaptureError(
            f"The reconstruction {folder} has no photo with a pose. Run COLMAP's mapper again, or "
            "name another reconstruction with --colmap-path."
        )
    return Reconstruction(folder, frames, _points(model))


def find_models(data: Path, colmap_path: Path) -> list[Path]:
    """Folders of COLMAP models as `read_reconstruction` finds them; empty if there are none."""
    for folder in (data / place for place in _places(colmap_path)):
        models = [folder] if _is_model(folder) else []
        if not models and folder.is_dir():
            models = [child for child in sorted(folder.iterdir()) if _is_model(child)]
        if models:
            return models
    return []


def _places(colmap_path: Path) -> list[Path]:
    """Where a model is looked for, in this order."""
    others = USUAL_FOLDERS if colmap_path in USUAL_FOLDERS else ()
    return [colmap_path, *(place for place in others if place != colmap_path)]


def _is_model(folder: Path) -> bool:
    return any(
        all((folder / f"{part}.{kind}").is_file() for part in ("cameras", "images", "points3D"))
        for kind in ("bin", "txt")
    )


def _read_model(folder: Path) -> pycolmap.Reconstruction:
    import pycolmap  # a quarter of a second: not for `--help`

    _check_points_file(folder / "points3D.bin")
    try:
        return pycolmap.Reconstruction(folder)
    except (ValueError, LookupError, RuntimeError, MemoryError) as error:
        lines = str(error).strip().splitlines()
        reason = _text_with_nan(folder) or (lines[0] if lines else "damaged")
        raise CaptureError(
            f"The reconstruction {folder} cannot be read: {reason}. Mend it, copy it again or run "
            "COLMAP's mapper again; another one can be named with --colmap-path."
        ) from error


def _check_points_file(path: Path) -> None:
    """Make sure that a binary file of points holds as many as it says.

    pycolmap 4.2.1 believes the file's counts and goes on reading behind its end, for ever where a
    count is damaged. A point has 51 bytes, of which the last 8 count the observations that follow,
    8 bytes each.
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
        raise CaptureError(
            f"The reconstruction {path.parent} cannot be read: {path.name} has {len(data)} bytes, "
            "which is not what its counts say. Copy it again or run COLMAP's mapper again; another "
            "one can be named with --colmap-path."
        )


def _text_with_nan(folder: Path) -> str:
    """Which text file has NaN or infinite numbers, which COLMAP writes but cannot read."""
    for name in ("points3D.txt", "images.txt", "cameras.txt"):
        file = folder / name
        text = file.read_text(encoding="utf8", errors="replace") if file.is_file() else ""
        bad = [
            line for line in text.splitlines() if {"nan", "-nan", "inf", "-inf"} & set(line.split())
        ]
        if bad:
            return f"{len(bad)} lines of {name} have NaN or infinite numbers, the first: {bad[0]}"
    return ""


def _registered(model: pycolmap.Reconstruction) -> list[pycolmap.Image]:
    images = model.images
    return [images[i] for i in sorted(images) if images[i].has_pose]


def _frame(image: pycolmap.Image, folder: Path) -> Frame:
    camera = image.camera
    assert camera is not None, "pycolmap links every image to its camera"
    model = camera.model.name
    if model not in CAMERA_TYPES:
        raise CaptureError(
            f"Camera {camera.camera_id} in {folder} (photo {image.name}) has the model {model}; "
            f"supported are {', '.join(CAMERA_TYPES)}. Undistort the photos first: `colmap "
            "image_undistorter --image_path IMAGES --input_path MODEL --output_path OUT`."
        )
    pose, intrinsics = np.asarray(image.cam_from_world().matrix()), _intrinsics(camera)
    numbers, sides = [*pose.flat, *intrinsics.values()], (camera.width, camera.height)
    if not (np.isfinite(numbers).all() and min(sides) >= 1 and max(sides) <= LARGEST_SIDE):
        raise CaptureError(
            f"Photo {image.name} in {folder} has a pose or a camera that cannot be: NaN or "
            f"infinite numbers, or {sides[0]}x{sides[1]} pixels; a side has 1 to {LARGEST_SIDE}. "
            "Remove the photo from the reconstruction, or run COLMAP's mapper again."
        )
    return Frame(
        name=Path(image.name).as_posix(),
        image_id=image.image_id,
        world_to_camera=pose,
        camera_type=CAMERA_TYPES[model],
        width=camera.width,
        height=camera.height,
        intrinsics=intrinsics,
    )


def _intrinsics(camera: pycolmap.Camera) -> dict[str, float]:
    """COLMAP's parameters by name; f stands for fx and fy, k for k1."""
    names = [name.strip() for name in camera.params_info.split(",")]
    values = dict(zip(names, (float(value) for value in camera.params), strict=True))
    if "f" in values:
        values["fx"] = values["fy"] = values.pop("f")
    if "k" in values:
        values["k1"] = values.pop("k")
    return values


def _points(model: pycolmap.Reconstruction) -> Points:
    by_id = model.points3D
    points = [by_id[i] for i in sorted(by_id)]
    return Points(
        xyz=np.array([point.xyz for point in points], dtype=np.float64).reshape(-1, 3),
        rgb=np.array([point.color for point in points], dtype=np.uint8).reshape(-1, 3),
        ids=np.array(sorted(by_id), dtype=np.int64),
    )
