"""Which photos share a camera: focal length and distortion are found for all of them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from statistics import median

from desplat_ns.process.photos import Photo
from desplat_ns.process.request import CameraModel, Cameras

FOCAL_OF_SIDE = 1.2
"""Focal length over the longer side that COLMAP starts from where nothing is known."""
TERMS = ((10, "RADIAL"), (3, "SIMPLE_RADIAL"), (1, "SIMPLE_PINHOLE"))
"""From so many photos of one camera on: two, one or no term of radial distortion. A term of a
single photo takes up whatever does not fit, up to values that no lens has."""


@dataclass(frozen=True)
class Camera:
    """A camera and the copies of photos that it took, all of one size."""

    model: str
    """COLMAP's name."""
    focal: float
    """Pixels, to start from."""
    focal_is_known: bool
    """Whether EXIF says so."""
    copies: tuple[str, ...]


def group_by_camera(photos: Sequence[Photo], cameras: Cameras, model: CameraModel) -> list[Camera]:
    """The cameras of photos.

    Photos share one if they have the same size, folder, make, model, lens and focal length. Where
    EXIF does not say, they share one by size, unless sizes are as mixed as those of photos of
    many people.

    Args:
        cameras: "one", "folder" and "photo" ask for fewer or more; photos of different sizes never
            share one.
    """
    without = [photo for photo in photos if not photo.camera]
    sizes = Counter((photo.width, photo.height) for photo in without)
    many_people = len(sizes) > max(2, len(without) / 3)

    def key(index: int, photo: Photo) -> tuple:
        size = (photo.width, photo.height)
        folder = str(PurePosixPath(photo.source).parent)
        if cameras == "photo" or (cameras == "auto" and many_people and not photo.camera):
            return (*size, index)
        if cameras == "auto":
            return (*size, folder, photo.camera, photo.focal)  # digital zoom changes the last alone
        return (*size, folder) if cameras == "folder" else size

    groups: dict[tuple, list[Photo]] = {}
    for index, photo in enumerate(photos):
        groups.setdefault(key(index, photo), []).append(photo)
    return [_camera(group, model) for group in groups.values()]


def _camera(photos: Sequence[Photo], model: CameraModel) -> Camera:
    known = [photo.focal for photo in photos if photo.focal]
    fitting = next(name for least, name in TERMS if len(photos) >= least)
    guess = FOCAL_OF_SIDE * max(photos[0].width, photos[0].height)
    return Camera(
        model=fitting if model == "auto" else model,
        focal=median(known) if known else guess,
        focal_is_known=bool(known),
        copies=tuple(photo.copy for photo in photos),
    )
