"""A generated capture as files, arranged as RobustNeRF's or as Photo Tourism's scenes."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap
from jaxtyping import Float, Int, UInt8

from desplat_ns.core.errors import ConfigError
from lab.pictures import write_image
from lab.synthetic.cameras import PinholeCamera
from lab.synthetic.scene import Frame, Scene, make_scene
from lab.synthetic.spec import SceneSpec

NAME = "yard"
"""Of the scene, in Photo Tourism's split file."""


def write_scene(spec: SceneSpec, folder: Path) -> Scene:
    """Make a scene and write it to `folder`; return its truth.

    Layout `robustnerf`: `images/{clean,clutter,extra}_NNNN.png` and `sparse/0/*.bin` (COLMAP).
    Layout `phototourism`: `dense/images/photo_NNNN.png` (training photos with occluders, then the
    extras as test photos), `dense/sparse/*.bin` and `yard.tsv` (NeRF-W's split: filename, id,
    split, dataset).

    In both: `masks/NAME.png` for each training photo with occluders (255 = occluder).
    Raises ConfigError where `folder` already holds pictures, and as `make_scene`.
    """
    dense = folder / "dense" if spec.layout == "phototourism" else folder
    if any((dense / "images").glob("*")):
        raise ConfigError(
            f"{dense / 'images'} already holds pictures and nothing was written. Remove "
            f"{folder} or name another folder."
        )
    scene = make_scene(spec)
    if spec.layout == "phototourism":
        _write_capture(scene, scene.clutter, dense / "images", dense / "sparse")
        _write_split(scene, folder / f"{NAME}.tsv")
    else:
        photos = scene.clutter + scene.clean
        _write_capture(scene, photos, dense / "images", dense / "sparse" / "0")
    for frame in scene.clutter:
        write_image(folder / "masks" / f"{frame.name}.png", frame.mask)
    return replace(scene, folder=folder)


def _write_images(frames: Sequence[Frame], folder: Path) -> None:
    for frame in frames:
        write_image(folder / f"{frame.name}.png", frame.image)


def _write_capture(scene: Scene, training: Sequence[Frame], images: Path, sparse: Path) -> None:
    """Training photos (once or twice all views) and extras, with their reconstruction."""
    _write_images([*training, *scene.extra], images)
    spec, points = scene.spec, scene.points
    noise = spec.rng(5).normal(scale=spec.point_noise, size=points.xyz.shape)
    write_reconstruction(sparse, register(scene, training), points.xyz + noise, points.rgb)


def register(scene: Scene, training: Sequence[Frame]) -> "list[RegisteredPhoto]":
    """Photos with their noisy observations; points hidden by occluders are not observed."""
    rng, points, views = scene.spec.rng(4), scene.points, scene.spec.num_views
    numbered = [(index % views, frame) for index, frame in enumerate(training)]
    numbered += [(views + index, frame) for index, frame in enumerate(scene.extra)]
    photos = []
    for view, frame in numbered:
        hidden = points.hidden_by(view, frame.coverage > 0)
        ids = np.flatnonzero(points.is_seen[view] & ~hidden)
        pixels, _ = frame.camera.project(points.xyz[:, ids])
        pixels = pixels + rng.normal(scale=scene.spec.pixel_noise, size=pixels.shape)
        photos.append(RegisteredPhoto(f"{frame.name}.png", frame.camera, ids, pixels))
    return photos


def _write_split(scene: Scene, path: Path) -> None:
    """One row for each photo; ids are those of the reconstruction, in its order."""
    rows = [(frame.name, "train") for frame in scene.clutter]
    rows += [(frame.name, "test") for frame in scene.extra]
    with path.open("w", newline="") as file:
        table = csv.writer(file, delimiter="\t", lineterminator="\n")
        table.writerow(["filename", "id", "split", "dataset"])
        for image_id, (name, split) in enumerate(rows, start=1):
            table.writerow([f"{name}.png", image_id, split, NAME])


@dataclass(frozen=True)
class RegisteredPhoto:
    """One photo, and which points were found in it at which pixels."""

    name: str
    camera: PinholeCamera
    point_ids: Int[np.ndarray, " M"]
    """Indices into the points of the reconstruction, from 0."""
    pixels: Float[np.ndarray, "2 M"]


def to_colmap(camera: PinholeCamera, camera_id: int) -> pycolmap.Camera:
    """A PINHOLE camera (fx, fy, cx, cy)."""
    K = camera.K
    return pycolmap.Camera(
        model="PINHOLE",
        width=camera.width,
        height=camera.height,
        params=[K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        camera_id=camera_id,
    )


def write_reconstruction(
    folder: Path,
    photos: Sequence[RegisteredPhoto],
    xyz: Float[np.ndarray, "3 N"],
    rgb: UInt8[np.ndarray, "3 N"],
) -> None:
    """Write cameras, images and points3D as binary files into `folder`, which is made if needed.

    Photos with the same intrinsics and size share a camera.
    """
    reconstruction = pycolmap.Reconstruction()
    camera_ids: dict[tuple[float, ...], int] = {}
    tracks = [pycolmap.Track() for _ in range(xyz.shape[1])]
    for image_id, photo in enumerate(photos, start=1):
        lens = (photo.camera.width, photo.camera.height, *photo.camera.K.ravel().tolist())
        if lens not in camera_ids:
            camera_ids[lens] = len(camera_ids) + 1
            camera = to_colmap(photo.camera, camera_ids[lens])
            reconstruction.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(
            name=photo.name,
            keypoints=photo.pixels.T,
            camera_id=camera_ids[lens],
            image_id=image_id,
        )
        pose = pycolmap.Rigid3d(photo.camera.viewmat[:3])
        reconstruction.add_image_with_trivial_frame(image, pose)
        for index, point in enumerate(photo.point_ids.tolist()):
            tracks[point].add_element(image_id, index)
    for point, track in enumerate(tracks):
        reconstruction.add_point3D(xyz[:, point], track, rgb[:, point])
    reconstruction.update_point_3d_errors()
    folder.mkdir(parents=True, exist_ok=True)
    reconstruction.write_binary(str(folder))
