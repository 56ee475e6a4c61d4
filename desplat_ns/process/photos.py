"""Photos as they are processed: upright, 8 bit, of a sensible size; their masks; and which of them
share a camera.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from statistics import median

import cv2
import numpy as np
import PIL.Image
from jaxtyping import UInt8

from desplat_ns.console import list_names
from desplat_ns.data.images import lens_of, read_image, read_mask, resize_image
from desplat_ns.data.photo_files import photo_names
from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import write_whole
from desplat_ns.process.request import CameraModel, Cameras

JPEG_QUALITY = 95
"""Of what is written: photos are written twice, so each time must cost nothing to be seen."""
SHARPNESS_SIDE = 800
"""Pixels of the longer side at which sharpness is measured, so that photos of all sizes compare."""
FILM_DIAGONAL = 43.2666
"""Millimetres across 35 mm film, which EXIF's focal length is for."""
TERMS = ((10, "RADIAL"), (3, "SIMPLE_RADIAL"), (1, "SIMPLE_PINHOLE"))
"""From so many photos of one camera on: two, one or no term of radial distortion. A term of a
single photo takes up whatever does not fit, up to values that no lens has."""


@dataclass(frozen=True)
class Photo:
    """One photo of the user's and its copy in the work folder."""

    source: str
    """Path below the sources' folder."""
    name: str
    """Path below OUTPUT/images."""
    copy: str
    """File in the work folder: a number, so that no program trips over spaces or umlauts."""
    width: int = 0
    height: int = 0
    """Pixels of the copy; 0 where there is none."""
    sharpness: float = 0.0
    """Variance of the Laplacian of grey values of 0 to 255."""
    camera: str = ""
    """Make, model, lens and focal length as EXIF gives them; empty where it does not."""
    focal: float = 0.0
    """Focal length in pixels of the copy by EXIF; 0 where it does not say."""
    problem: str = ""
    """Why it cannot be used; empty where it can."""


@dataclass(frozen=True)
class Camera:
    """A camera and the copies of photos that it took, all of one size."""

    model: str
    """COLMAP's name."""
    width: int
    height: int
    focal: float
    """Pixels, by EXIF; 0 where it does not say."""
    copies: tuple[str, ...]


def numbered(sources: Sequence[str]) -> list[Photo]:
    """A photo for each source; no two share a name: `a.png` beside `a.jpg` is `a_png.jpg`."""
    photos: list[Photo] = []
    taken: set[str] = set()
    for number, source in enumerate(sources, 1):
        path = PurePosixPath(source)
        name = str(path.with_suffix(".jpg"))
        if name.lower() in taken:
            name = str(path.with_name(f"{path.stem}_{path.suffix[1:]}.jpg"))
        taken.add(name.lower())
        photos.append(Photo(source, name, f"{number:05d}.jpg"))
    return photos


def prepare_photos(
    folder: Path,
    sources: Sequence[str],
    copies: Path,
    longest_side: int,
    threads: int,
    progress: Callable[[int, int], None],
) -> list[Photo]:
    """Copy all photos to `copies`, and say of each what was seen. A second call writes the same.

    Args:
        folder: of the sources.
        longest_side: in pixels; larger photos are reduced by area.
        progress: called with the number of photos that are done and that of all.

    Raises:
        OSError: a copy cannot be written.
    """
    copies.mkdir(parents=True, exist_ok=True)
    photos, first = [], dict[str, str]()
    with ThreadPoolExecutor(threads) as pool:
        copied = pool.map(lambda p: _copy(folder, p, copies, longest_side), numbered(sources))
        for photo, digest in copied:
            twin = first.setdefault(digest, photo.source)
            if twin != photo.source:
                photo = replace(photo, problem=f"the same picture as {twin}")
            photos.append(photo)
            progress(len(photos), len(sources))
    return photos


def _copy(folder: Path, photo: Photo, copies: Path, longest_side: int) -> tuple[Photo, str]:
    """Write the copy; what was seen, and a digest of the pixels or, without any, the source."""
    path = folder / photo.source
    try:
        pixels = np.ascontiguousarray(read_image(path)[..., :3])
    except CaptureError as error:
        return replace(photo, problem=str(error)), photo.source
    scale = min(1.0, longest_side / max(pixels.shape[:2]))
    height, width = (max(1, round(side * scale)) for side in pixels.shape[:2])
    pixels = resize_image(pixels, width, height)
    encoded, lens = io.BytesIO(), lens_of(path)
    PIL.Image.fromarray(pixels).save(encoded, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    write_whole(copies / photo.copy, encoded.getvalue())
    seen = replace(
        photo,
        width=width,
        height=height,
        sharpness=round(sharpness(pixels), 2),
        camera=lens.name,
        focal=round(lens.focal_35mm / FILM_DIAGONAL * float(np.hypot(width, height)), 2),
    )
    return seen, hashlib.sha1(pixels.tobytes()).hexdigest()


def sharpness(pixels: UInt8[np.ndarray, "H W 3"]) -> float:
    """Variance of the Laplacian of a photo's grey values, at `SHARPNESS_SIDE` pixels at most."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    scale = SHARPNESS_SIDE / max(grey.shape)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())


def prepare_masks(mask: Path, photos: Sequence[Photo], copies: Path) -> int:
    """Write `copies`/COPY.png for each photo that has a mask: black where no feature may be, as on
    a watermark, a dashboard or a selfie stick.

    Args:
        mask: a picture for all photos, or a folder with one for each, named as the photo, with any
            ending (`a.png` or `a.jpg.png` for `a.jpg`).

    Returns:
        How many photos have one.

    Raises:
        CaptureError: none has one, or one has another shape than its photo, or cannot be read.
    """
    names = [] if mask.is_file() else photo_names(mask)
    there = {str(PurePosixPath(name).with_suffix("")).lower(): mask / name for name in names}
    paths = {
        photo: mask
        if mask.is_file()
        else there.get(photo.source.lower())
        or there.get(str(PurePosixPath(photo.source).with_suffix("")).lower())
        for photo in photos
    }
    if not any(paths.values()):
        raise CaptureError(
            f"No mask in {mask} belongs to a photo (it has {list_names(names, 5)}). "
            f"Needed are files named as the photos: {Path(photos[0].source).stem}.png for "
            f"{photos[0].source}; or name one picture that is the mask of all."
        )
    copies.mkdir(parents=True, exist_ok=True)
    for photo, path in paths.items():
        if path is not None:
            white = read_mask(path)
            height, width = white.shape
            if abs(width / height - photo.width / photo.height) > 0.02 * width / height:
                raise CaptureError(
                    f"Mask {path} has {width}x{height} pixels, {photo.source} is of another shape "
                    f"({photo.width}x{photo.height} as used). Make it of the photo's size."
                )
            values = white.astype(np.uint8) * 255
            size = photo.width, photo.height
            resized = cv2.resize(values, size, interpolation=cv2.INTER_AREA)
            picture = PIL.Image.fromarray((resized > 127).astype(np.uint8) * 255)
            picture.save(copies / f"{photo.copy}.png")
    return sum(path is not None for path in paths.values())


def group_by_camera(photos: Sequence[Photo], cameras: Cameras, model: CameraModel) -> list[Camera]:
    """The cameras of photos: focal length and distortion are found for all photos of one together.

    Photos share one if they have the same size, folder, make, model, lens and focal length. Where
    EXIF does not say, they share one by size, unless sizes are as mixed as those of photos of
    many people.

    Args:
        cameras: "one", "folder" and "photo" ask for fewer or more; photos of different sizes never
            share one.
    """
    without = [photo for photo in photos if not photo.camera]
    sizes = {(photo.width, photo.height) for photo in without}
    many_people = len(sizes) > max(2, len(without) / 3)
    groups: dict[tuple, list[Photo]] = {}
    for photo in photos:
        folder = str(PurePosixPath(photo.source).parent)
        key: tuple = (photo.width, photo.height)
        if cameras == "photo" or (cameras == "auto" and many_people and not photo.camera):
            key += (photo.copy,)
        elif cameras == "auto":
            key += (folder, photo.camera, photo.focal)  # digital zoom changes the last alone
        elif cameras == "folder":
            key += (folder,)
        groups.setdefault(key, []).append(photo)
    cameras_found = []
    for group in groups.values():
        fitting = next(name for least, name in TERMS if len(group) >= least)
        known = [photo.focal for photo in group if photo.focal]
        found = Camera(
            model=fitting if model == "auto" else model,
            width=group[0].width,
            height=group[0].height,
            focal=median(known) if known else 0.0,
            copies=tuple(photo.copy for photo in group),
        )
        cameras_found.append(found)
    return cameras_found
