"""Photos as they are processed: upright, 8 bit, of a sensible size; their masks and cameras.

Letters in shapes: H x W pixels."""

import hashlib
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import PIL.Image
from jaxtyping import Float32, UInt8

from desplat_ns.core.console import list_names, progress_over
from desplat_ns.core.cores import cores
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.whole import draft_of
from desplat_ns.data.images import lens_of, read_image, read_mask, resize_image, resize_mask
from desplat_ns.data.photo_files import photo_names
from desplat_ns.tools.process.request import Cameras

JPEG_QUALITY = 95
"""Of what is written: photos are written twice, so each time must cost nothing to be seen."""
SHARPNESS_SIDE = 800
"""Pixels of the longer side at which sharpness is measured, so that photos of all sizes compare."""
FILM_DIAGONAL = 43.2666
"""Millimetres across 35 mm film, which EXIF's focal length is for."""
PANORAMA = re.compile(rb"""GPano:ProjectionType\s*(=\s*["']|>)\s*(?!rectilinear|perspective)\w""")
"""In XMP, which stands as text in files of any format."""
ALIKE, DETAIL, POLES = 0.4, 1.5, 0.8
"""Of `wraps_around`. 36 panoramas of nine real places have 0.63, 3.9 and more of the first two and
0.68 at most of the last; of 337 crops of photos none has more than 0.31 of the first."""


@dataclass(frozen=True)
class Photo:
    """One photo of the user's and its copy in the work folder."""

    source: str
    """Path below the sources' folder."""
    name: str
    """Path below OUTPUT/images: a PNG where something is transparent, else a JPEG."""
    copy: str
    """File in the work folder: a number, so that no program trips over spaces or umlauts."""
    width: int = 0
    height: int = 0
    """Pixels of the copy; 0 where there is none."""
    sharpness: float = 0.0
    """Variance of the Laplacian of grey values of 0 to 255."""
    camera: str = ""
    """Make, model, lens and focal length as EXIF gives them; empty where it does not."""
    focal_35mm: float = 0.0
    """Focal length in millimetres, as on 35 mm film, by EXIF; 0 where it does not say."""
    problem: str = ""
    """Why it cannot be used; empty where it can."""

    @property
    def focal(self) -> float:
        """Focal length in pixels of the copy; 0 where EXIF does not say."""
        return self.focal_35mm * float(np.hypot(self.width, self.height)) / FILM_DIAGONAL


def numbered(sources: Sequence[str]) -> list[Photo]:
    """A photo for each source; no two share a name: `a.png` beside `a.jpg` is `a_png.jpg`."""
    photos, taken = list[Photo](), set[str]()
    for number, source in enumerate(sources, 1):
        path = PurePosixPath(source)
        name = str(path.with_suffix(".jpg"))
        if name.lower() in taken:
            name = str(path.with_name(f"{path.stem}_{path.suffix[1:]}.jpg"))
        taken.add(name.lower())
        photos.append(Photo(source, name, f"{number:05d}.jpg"))
    return photos


def prepare_photos(
    folder: Path, sources: Sequence[str], copies: Path, longest_side: int
) -> list[Photo]:
    """Copy all photos to `copies` and their alpha to `masks` beside it (COPY.png), and say of each
    what was seen. A second call writes the same. Photos with more pixels on a side than
    `longest_side` are reduced by area. Raises OSError where a copy cannot be written."""
    copies.mkdir(parents=True, exist_ok=True)
    photos, first = [], dict[str, str]()
    with ThreadPoolExecutor(cores()) as pool, progress_over(len(sources), "Photos") as advance:
        copied = pool.map(lambda p: _copy(folder, p, copies, longest_side), numbered(sources))
        for photo, digest in copied:
            twin = first.setdefault(digest, photo.source)
            if twin != photo.source:
                photo = replace(photo, problem=f"the same picture as {twin}")
            photos.append(photo)
            advance()
    return photos


def _copy(folder: Path, photo: Photo, copies: Path, longest_side: int) -> tuple[Photo, str]:
    """Write the copy; what was seen, and a digest of the pixels or, without any, the source."""
    path = folder / photo.source
    try:
        image = read_image(path)
        check_projection(path, image)
    except CaptureError as error:
        return replace(photo, problem=str(error)), photo.source
    scale = min(1.0, longest_side / max(image.shape[:2]))
    height, width = (max(1, round(side * scale)) for side in image.shape[:2])
    image, lens = resize_image(image, width, height), lens_of(path)
    pixels = np.ascontiguousarray(image[..., :3])
    write_picture(copies / photo.copy, pixels)
    alpha = image[..., 3] if image.shape[2] == 4 else np.full(image.shape[:2], 255, np.uint8)
    write_picture(copies.with_name("masks") / f"{photo.copy}.png", alpha)
    if (alpha < 255).any():
        photo = replace(photo, name=f"{photo.name.removesuffix('.jpg')}.png")
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    reduced = min(1.0, SHARPNESS_SIDE / max(grey.shape))
    grey = cv2.resize(grey, None, fx=reduced, fy=reduced, interpolation=cv2.INTER_AREA)
    sharpness = round(float(cv2.Laplacian(grey, cv2.CV_64F).var()), 2)
    seen = replace(photo, width=width, height=height, sharpness=sharpness)
    seen = replace(seen, camera=lens.name, focal_35mm=lens.focal_35mm)
    return seen, hashlib.sha1(image.tobytes()).hexdigest()


def write_picture(path: Path, pixels: UInt8[np.ndarray, "H W *C"]) -> None:
    """Write a JPEG or PNG, by its ending, whole or not at all. Raises OSError."""
    with draft_of(path) as draft:
        PIL.Image.fromarray(pixels).save(draft, quality=JPEG_QUALITY, subsampling=0)


def check_projection(path: Path, image: UInt8[np.ndarray, "H W C"]) -> None:
    """Raise CaptureError of what is no perspective view, so that poses would be off: a panorama by
    its file, or a 360-degree picture or two fisheye circles, twice as wide as high."""
    small = cv2.resize(image[..., :3], (512, 256), interpolation=cv2.INTER_AREA).astype(np.float32)
    is_wide = abs(image.shape[1] - 2 * image.shape[0]) <= 0.005 * image.shape[1]
    if is_wide and shows_two_circles(small):
        raise CaptureError("two fisheye circles: make perspective views with the camera's program")
    if (is_wide and wraps_around(small)) or PANORAMA.search(path.read_bytes()):
        raise CaptureError(
            "a 360-degree picture or panorama: split it into perspective views, for example with "
            "nerfstudio's `ns-process-data images` or `video` and `--camera-type equirectangular`"
        )


def wraps_around(small: Float32[np.ndarray, "256 512 3"]) -> bool:
    """Whether left and right edge continue each other in their details, and the top and the bottom
    row, each one point of a sphere, vary less than others. What stands out is clipped: a table
    that both edges show at one height is no evidence."""
    edges = small[:, [0, -1]]
    details = (edges - cv2.blur(edges, (1, 15))).transpose(1, 0, 2).reshape(2, -1)
    most = np.quantile(np.abs(details), 0.75, axis=1, keepdims=True)
    rows = np.abs(small - small.mean(axis=1, keepdims=True)).mean(axis=(1, 2))
    if most.min() < DETAIL or rows[0] + rows[-1] > POLES * np.median(rows):
        return False
    return bool(np.corrcoef(details.clip(-most, most))[0, 1] > ALIKE)


def shows_two_circles(small: Float32[np.ndarray, "256 512 3"]) -> bool:
    """Whether each half is bright in a ring and black outside of the circle that fills it."""
    radius, bright = np.hypot(*np.mgrid[-1:1:256j, -1:1:256j]), small.max(axis=2) > 24
    ring, outside = (radius > 0.6) & (radius < 0.9), radius > 1.1
    halves = bright[:, :256], bright[:, 256:]
    return all(half[ring].mean() > 0.6 and half[outside].mean() < 0.05 for half in halves)


def prepare_masks(mask: Path, photos: Sequence[Photo], copies: Path) -> int:
    """Blacken COPY.png in `copies` for each photo that has a mask: where no feature may be, as on a
    watermark, a dashboard or a selfie stick. Says how many have one. Raises CaptureError where none
    has one, or one has another shape than its photo, or cannot be read.

    Args:
        mask: a picture for all photos, or a folder with one for each, named as the photo, with any
            ending (`a.png` or `a.jpg.png` for `a.jpg`), in a folder as the photo's or in none.
    """
    names = photo_names(mask)
    masks = {str(PurePosixPath(name).with_suffix("")).lower(): mask / name for name in names}
    count = 0
    for photo in photos:
        source = PurePosixPath(photo.source.lower())
        keys = map(str, (source, source.with_suffix(""), source.name, source.stem))
        path = mask if mask.is_file() else next((masks[key] for key in keys if key in masks), None)
        if path is None:
            continue
        white, count = read_mask(path), count + 1
        height, width = white.shape
        if abs(width / height - photo.width / photo.height) > 0.02 * width / height:
            raise CaptureError(
                f"Mask {path} has {width}x{height} pixels, {photo.source} is of another shape "
                f"({photo.width}x{photo.height} as used). Make it of the photo's size."
            )
        allowed = resize_mask(white, photo.width, photo.height).astype(np.uint8) * 255
        target = copies / f"{photo.copy}.png"
        write_picture(target, np.minimum(allowed, read_image(target)[..., 0]))
    if count == 0:
        raise CaptureError(
            f"No mask in {mask} belongs to a photo (it has {list_names(names, 5)}). Needed are "
            "files named as the photos, or name one picture that is the mask of all."
        )
    return count


def group_by_camera(photos: Sequence[Photo], cameras: Cameras) -> list[list[Photo]]:
    """Photos of one camera each: focal length and distortion are found for them together.

    Photos share one if they have the same size, folder, make, model, lens and focal length. Where
    EXIF does not say, they share one by size, unless sizes are as mixed as those of photos of
    many people. `cameras` may ask for fewer or more, but photos of different sizes never share one.
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
            key += (folder, photo.camera, photo.focal_35mm)  # digital zoom changes the last alone
        elif cameras == "folder":
            key += (folder,)
        groups.setdefault(key, []).append(photo)
    return list(groups.values())
