"""transforms.json, as nerfstudio, instant-ngp and other programs write it."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from nerfstudio.cameras.cameras import CameraType
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

from desplat_ns.core.console import announce_once
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import DeSplatColmapDataParser, with_pycolmap
from desplat_ns.data.colmap_model import UNEXPECTED
from desplat_ns.data.images import image_size
from desplat_ns.data.point_cloud import NO_POINTS, Points, read_cloud
from desplat_ns.data.reconstruction import (
    Frame,
    Reconstruction,
    camera_type_of,
    check_frame,
    read_reconstruction,
)

_OLD_WORLD = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]])
"""From COLMAP's world to that of an old ns-process-data, which did not write it."""

MODEL = Path("colmap/sparse/0")
"""Where ns-process-data leaves COLMAP's model."""

_LENS = ("k1", "k2", "k3", "k4", "p1", "p2")

_SYNONYMS = {"PERSPECTIVE": "OPENCV", "FISHEYE": "OPENCV_FISHEYE"}
"""nerfstudio's and instant-ngp's names of lenses to COLMAP's."""

_FLAGS = ("fisheye", "ftheta", "latlong", "equirectangular", "panorama", "orthographic")
"""Lenses in names of keys, as instant-ngp's `is_fisheye`, `latlong`, `ftheta_p0`."""


class TransformsDataParser(DeSplatColmapDataParser):
    """nerfstudio's `nerfstudio-data`, read as COLMAP captures are: it asks and writes nothing."""

    def __init__(self, config: NerfstudioDataParserConfig):
        data = config.data
        self._path = data if data.suffix == ".json" else data / "transforms.json"
        super().__init__(with_pycolmap(config, data=self._path.parent))

    def read(self) -> Reconstruction:
        """Raises as `read_transforms`."""
        return read_transforms(self._path, self.config.load_3D_points)


def read_transforms(path: Path, with_points: bool) -> Reconstruction:
    """Photos in the order of their names; points of the file's PLY, else of the COLMAP model that
    ns-process-data made it of, moved as it moved the poses.

    A frame's own numbers come before those of the head. Raises CaptureError: no such file, or
    contents that cannot be used; names the frame.
    """
    folder = path.parent
    if not path.is_file():
        raise CaptureError(
            f"The capture {folder} has no {path.name}. Check --data, or end the command with "
            f"another dataparser: `colmap --data {folder}` where COLMAP made the reconstruction."
        )
    frames, where = [], "its head"
    try:
        document = json.loads(path.read_text("utf-8-sig"))
        head = {key: value for key, value in document.items() if key != "frames"}
        to_world = np.eye(4)
        is_old = (folder / MODEL).exists()
        applied = head.get("applied_transform", _OLD_WORLD if is_old else to_world[:3])
        to_world[:3] = np.array(applied, np.float64)[:3] * float(head.get("applied_scale", 1))
        lists = {s: head.get(f"{s}_filenames") for s in ("train", "val", "test")}
        lists = {s: [_name(name, folder) for name in names] for s, names in lists.items() if names}
        cloud = folder / head["ply_file_path"] if head.get("ply_file_path") else None
        for number, row in enumerate(document["frames"]):
            where = f"frames[{number}]"
            frames.append(_frame(head | row, path))
    except UNEXPECTED as error:
        raise CaptureError(
            f"{path} cannot be used: in {where}, {type(error).__name__}: {error}. It needs a list "
            "`frames`, each with file_path, transform_matrix (rows of the camera's pose) and, in "
            "the frame or the head, fl_x, fl_y, cx, cy, w, h in pixels as numbers; camera_angle_x "
            "stands in for fl_x. Mend it or write it again."
        ) from error
    if not frames:
        raise CaptureError(f"{path} has no frames. Write it again, with a pose for each photo.")
    # The folder that all share has copies of reduced photos beside it, as images_2 for images.
    tops = {frame.name.partition("/")[0] if "/" in frame.name else "" for frame in frames}
    top = tops.pop() if len(tops) == 1 else ""
    above = f"{top}/" if top else ""
    frames = [
        replace(frame, name=frame.name.removeprefix(above), image_id=number)
        for number, frame in enumerate(sorted(frames, key=lambda frame: Path(frame.name)))
    ]
    lists = {s: [name.removeprefix(above) for name in names] for s, names in lists.items()}
    return Reconstruction(
        folder=folder,
        frames=frames,
        points=_points(cloud, folder, to_world) if with_points else NO_POINTS,
        photos=folder / top,
        is_upright=True,
        orientation=head.get("orientation_override"),
        splits=lists,
    )


def _name(given: str, folder: Path) -> str:
    """A file's path below the folder; also one that was written on Windows."""
    is_windows = "\\" in given and not (folder / given).exists()
    return Path(given.replace("\\", "/") if is_windows else given).as_posix()


def _frame(row: dict[str, Any], path: Path) -> Frame:
    """A frame with the head's numbers in it; not numbered yet."""
    name = _name(row["file_path"], path.parent)
    pose = np.eye(4)
    matrix = np.array(row["transform_matrix"], np.float64)
    if matrix.shape not in ((3, 4), (4, 4)) or np.abs(matrix[3:] - pose[3]).sum() > 1e-3:
        raise ValueError("transform_matrix must have 4 columns and the last row 0 0 0 1")
    pose[:3] = matrix[:3]
    pose[:, 1:3] *= -1  # OpenGL's axes to OpenCV's
    if "w" in row and "h" in row:
        width, height = int(row["w"]), int(row["h"])
    else:
        width, height = image_size(path.parent / name)
    focal: dict[str, Any] = {axis: row.get(f"fl_{axis}") for axis in "xy"}
    for axis, side in (("x", width), ("y", height)):
        if f"fl_{axis}" not in row and f"camera_angle_{axis}" in row:
            focal[axis] = side / 2 / math.tan(float(row[f"camera_angle_{axis}"]) / 2)
    lens = dict(zip(_LENS, row.get("distortion_params") or (), strict=False))
    lens |= {key: row[key] for key in _LENS if key in row and not lens}
    mask = row.get("mask_path") or row.get("mask_filename")
    frame = Frame(
        name=name,
        image_id=0,
        world_to_camera=np.linalg.inv(pose)[:3],
        camera_type=_camera_type(row, name, path),
        width=width,
        height=height,
        intrinsics={
            "fx": float(focal["x"]),
            "fy": float(focal["x"] if focal["y"] is None else focal["y"]),
            "cx": float(row.get("cx", width / 2)),
            "cy": float(row.get("cy", height / 2)),
            **{key: float(value) for key, value in lens.items()},
        },
        mask=path.parent / _name(mask, path.parent) if mask else None,
    )
    check_frame(frame, path)
    return frame


def _camera_type(row: dict[str, Any], name: str, path: Path) -> CameraType:
    """By all names of its lens in a frame; a perspective one where there are none. Raises
    CaptureError: a lens that is not supported, or two of different kinds."""
    models = {str(row[key]).upper() for key in ("camera_model", "camera_type") if row.get(key)}
    for key, value in row.items():
        flag = key.lower().removeprefix("is_").partition("_")[0]
        if flag in _FLAGS and value and str(value).lower() != "false":
            models.add(flag.upper())
    kinds = {camera_type_of(_SYNONYMS.get(m, m), name, path): m for m in sorted(models)}
    if len(kinds) > 1:
        two = " and ".join(kinds.values())
        raise CaptureError(f"{path} gives photo {name} two lenses, {two}. Take out the wrong one.")
    return next(iter(kinds), CameraType.PERSPECTIVE)


def _points(cloud: Path | None, folder: Path, to_world: Float[np.ndarray, "4 4"]) -> Points:
    """The points to start from; none where nothing gives them, which is said."""
    points = NO_POINTS
    if cloud is not None:
        points = read_cloud(cloud)
    elif (folder / MODEL).is_dir():
        points = read_reconstruction(folder, MODEL).points
        points = replace(points, xyz=points.xyz @ to_world[:3, :3].T + to_world[:3, 3])
    if not len(points.xyz):
        announce_once(f"{folder} names no 3D points: training starts at random.", warning=True)
    return points
