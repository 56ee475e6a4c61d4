"""What is known of a capture's photos and scene, whatever file says so, and how COLMAP's models are
read into it.

Letters in shapes: P points, M observations.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int
from nerfstudio.cameras.cameras import CameraType

from desplat_ns.core.console import announce_once
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap_model import find_models, places_of, read_model
from desplat_ns.data.point_cloud import Points, points_of, read_cloud

if TYPE_CHECKING:
    import pycolmap

CAMERA_MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FISHEYE_MODELS = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
"""COLMAP's camera models that nerfstudio can undistort."""

LARGEST_SIDE = 1 << 16
"""Pixels. No photo has a longer side; a camera that says so is damaged."""

TRACKS = "point_tracks"
"""Where a data parser leaves a `Tracks` in its metadata, beside `points3D_xyz`."""


@dataclass(frozen=True)
class Frame:
    """One photo with a known pose."""

    name: str
    """Path inside the images folder, with forward slashes."""
    image_id: int
    """The reconstruction's own number of the photo."""
    world_to_camera: Float[np.ndarray, "3 4"]
    """OpenCV axes, the reconstruction's own units."""
    camera_type: CameraType
    width: int
    height: int
    intrinsics: dict[str, float]
    """fx, fy, cx, cy in pixels; k1 .. k4, p1, p2 where the model has them."""
    mask: Path | None = None
    """Where the photo may be used, if the reconstruction names a file."""


@dataclass(frozen=True)
class Reconstruction:
    """Photos with a pose, and points, whatever file said so, in its own world and units."""

    folder: Path
    """Where it was read."""
    frames: list[Frame]
    """Ordered by image id (nerfstudio's order)."""
    points: Points
    has_tracks: bool = False
    """Whether it says which photo observed which point."""
    photos: Path | None = None
    """Folder in which the frames' names are; None where the data parser's options say it."""
    is_upright: bool = False
    """z is up, as in transforms.json; without it -y is COLMAP's guess."""
    orientation: str | None = None
    """nerfstudio's orientation method that the file asks for."""
    splits: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Names of the photos of each split that the file lists."""


@dataclass(frozen=True)
class Tracks:
    """Where to read what the photos of a split observe, which training does not need."""

    folder: Path
    """The reconstruction."""
    image_ids: tuple[int, ...]
    """Of the photos, in the order of the split."""
    point_ids: Int[np.ndarray, " P"]
    """Of the capture's points, in their order, which is ascending."""

    def read(self, photos: Sequence[int]) -> list[Int[np.ndarray, " M"]]:
        """The points, as indices into those of the capture, that some photos, given by their
        numbers in the split, observe. Raises CaptureError as `read_model`."""
        model, observed = read_model(self.folder), []
        for photo in photos:
            found = model.image(self.image_ids[photo]).get_observation_points2D()
            ids = np.array([point.point3D_id for point in found], dtype=np.int64)
            observed.append(np.searchsorted(self.point_ids, ids[np.isin(ids, self.point_ids)]))
        return observed


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
    folders = find_models(data, colmap_path)
    if not folders:
        raise CaptureError(
            f"No COLMAP reconstruction in {data} (looked in "
            f"{', '.join(map(str, places_of(colmap_path)))}). Needed: a folder with cameras, "
            "images and points3D as .bin or .txt (points also as .ply). Run COLMAP first, or name "
            "the folder with --colmap-path, relative to --data."
        )
    files = (path for folder in folders for path in sorted(folder.iterdir()) if path.is_file())
    states = ((path, path.stat()) for path in files)
    changing = ((path, s.st_mtime_ns, s.st_size, s.st_ino) for path, s in states)
    return _largest(tuple(folders), tuple(changing))


@lru_cache(maxsize=1)
def _largest(folders: tuple[Path, ...], _states: tuple[Any, ...]) -> Reconstruction:
    """The model with most photos; read anew where a file is in another state."""
    models = {folder: read_model(folder) for folder in folders}
    folder, model = max(models.items(), key=lambda entry: entry[1].num_reg_images())
    if len(models) > 1:
        announce_once(
            f"Reconstruction: {folder} with {model.num_reg_images()} photos, the largest of "
            f"{len(models)}."
        )
    images = (model.image(i) for i in sorted(model.images))
    frames = [_frame(image, folder) for image in images if image.has_pose]
    if not frames:
        raise CaptureError(
            f"The reconstruction {folder} has no photo with a pose. Run COLMAP's mapper again, or "
            "name another reconstruction with --colmap-path."
        )
    has_tracks = any(point.track.length() for point in model.points3D.values())
    cloud = folder / "points3D.ply"
    points = points_of(model) if model.points3D or not cloud.is_file() else read_cloud(cloud)
    return Reconstruction(folder, frames, points, has_tracks)


def _frame(image: "pycolmap.Image", folder: Path) -> Frame:
    camera = image.camera
    assert camera is not None, "pycolmap links every image to its camera"
    try:
        name = Path(image.name).as_posix()
    except UnicodeDecodeError as error:  # `check_frame` refuses it
        name = error.object.decode(errors="surrogateescape")
    keys = [key.strip() for key in camera.params_info.split(",")]
    lens = dict(zip(keys, map(float, camera.params), strict=True))
    if "f" in lens:
        lens["fx"] = lens["fy"] = lens.pop("f")
    if "k" in lens:
        lens["k1"] = lens.pop("k")
    frame = Frame(
        name=name,
        image_id=image.image_id,
        world_to_camera=np.asarray(image.cam_from_world().matrix()),
        camera_type=camera_type_of(camera.model.name, name, folder),
        width=camera.width,
        height=camera.height,
        intrinsics=lens,
    )
    check_frame(frame, folder)
    return frame


def camera_type_of(model: str, photo: str, source: Path) -> CameraType:
    """nerfstudio's kind of a camera model. Raises CaptureError where it cannot be undistorted."""
    if model not in CAMERA_MODELS + FISHEYE_MODELS:
        raise CaptureError(
            f"The camera of photo {photo} in {source} has the model {model}; supported are "
            f"{', '.join(CAMERA_MODELS + FISHEYE_MODELS)}. Undistort the photos first: `colmap "
            "image_undistorter --image_path IMAGES --input_path MODEL --output_path OUT`; of "
            "panoramas make perspective photos (`ns-process-data images --camera-type "
            "equirectangular`)."
        )
    return CameraType.FISHEYE if model in FISHEYE_MODELS else CameraType.PERSPECTIVE


def check_frame(frame: Frame, source: Path) -> None:
    """Raise CaptureError, with the photo and `source`, where it was read, unless its name, pose and
    camera can be."""
    lens, name, sides = frame.intrinsics, frame.name, (frame.width, frame.height)
    with np.errstate(over="ignore"):
        numbers = np.array([*frame.world_to_camera.flat, *lens.values()]).astype(np.float32)
    inside = max(abs(lens["cx"]), abs(lens["cy"]), *sides) <= LARGEST_SIDE
    bent = frame.camera_type is CameraType.PERSPECTIVE and lens.get("k4")
    is_possible = np.isfinite(numbers).all() and inside and not bent
    if not (is_possible and min(lens["fx"], lens["fy"], *sides) > 0):
        raise CaptureError(
            f"Photo {name} in {source} has a pose or a camera that cannot be: {sides[0]}x{sides[1]}"
            f" pixels, {lens}. Needed are finite numbers, focal lengths above 0, sides and a "
            f"principal point of at most {LARGEST_SIDE} pixels, and k4 of a fisheye only, as of "
            "OPENCV_FISHEYE. Remove the photo there, or make the reconstruction again."
        )
    if re.search(r"[\ud800-\udfff]", name):
        raise CaptureError(
            f"A photo in {source} has the name {name!a}, which is no UTF-8. Rename the photo there "
            "and in its folder."
        )
