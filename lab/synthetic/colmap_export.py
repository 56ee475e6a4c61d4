"""A COLMAP reconstruction, written through pycolmap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap
from jaxtyping import Float, Int, UInt8

from lab.synthetic.cameras import PinholeCamera


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
