"""Photos as pixels: upright, 8 bit, RGB or RGBA; and what files say of their lens.

By Pillow; HEIC, in which iPhones keep photos, needs pillow-heif, an extra.

Letters in shapes: H x W pixels, C channels.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError

from desplat_ns.errors import CaptureError

MOST_PIXELS = 1 << 28
"""Of a photo, 16,384 x 16,384; one whose header says more is not decoded."""
Image.MAX_IMAGE_PIXELS = MOST_PIXELS // 2  # Pillow refuses twice as many


class Lens(NamedTuple):
    """What a photo was taken with, as its file gives it: often absent, sometimes wrong."""

    name: str = ""
    """Make, model, lens and focal length in millimetres; empty where the file says nothing."""
    focal_35mm: float = 0.0
    """Millimetres, as on 35 mm film; 0 where the file does not say."""


def read_image(path: Path, camera: tuple[int, int] | None = None) -> UInt8[np.ndarray, "H W C"]:
    """The photo, RGB (C = 3) or RGBA (C = 4).

    Without a camera it is turned as EXIF says. For a camera, given by width and height, pixels come
    as they are stored, as COLMAP and nerfstudio read them; they are turned only where EXIF names a
    quarter turn without which they do not have the camera's shape.

    Grey becomes RGB; samples of 16 bits are reduced to 8. Alpha is not multiplied into the colours.

    Raises:
        CaptureError: the file is missing, is no image, has more than `MOST_PIXELS` or samples of 32
            bits, or ends too early.
    """
    with _open(path) as image:
        is_turned = _orientation(image, camera) > 1
        if image.mode in ("I", "F"):
            raise _unreadable(path, "its samples have 32 bits, and photos have 8 or 16")
        try:
            upright: Image.Image = ImageOps.exif_transpose(image) if is_turned else image
            if upright.mode.startswith("I;16"):
                upright = Image.fromarray(np.rint(np.asarray(upright) / 257).astype(np.uint8))
            return np.array(upright.convert("RGBA" if upright.has_transparency_data else "RGB"))
        except Exception as error:  # damage ends in errors of many kinds
            raise _unreadable(path, str(error)) from error


def image_size(path: Path, camera: tuple[int, int] | None = None) -> tuple[int, int]:
    """(width, height) in pixels, turned as `read_image` does it; reads the header only.

    Raises:
        CaptureError: the file is missing, is not an image, or has more than `MOST_PIXELS`.
    """
    with _open(path) as image:
        return image.size[::-1] if _orientation(image, camera) >= 5 else image.size


def lens_of(path: Path) -> Lens:
    """What the file says about camera and lens; nothing where it is missing or is no photo."""
    try:
        with _open(path) as image:
            tags = Image.Image.getexif(image)
        inner = tags.get_ifd(ExifTags.IFD.Exif)
        names = [tags.get(ExifTags.Base.Make), tags.get(ExifTags.Base.Model)]
        names += [inner.get(ExifTags.Base.LensModel), inner.get(ExifTags.Base.FocalLength)]
        focal = float(inner.get(ExifTags.Base.FocalLengthIn35mmFilm) or 0)
    except Exception:  # damaged tags end in errors of many kinds
        return Lens()
    name = " ".join(str(value).strip("\0 ") for value in names if value)
    return Lens(name, focal if np.isfinite(focal) and focal > 0 else 0.0)


def read_mask(path: Path, camera: tuple[int, int] | None = None) -> Bool[np.ndarray, "H W"]:
    """Where the mask is neither black nor transparent, turned as `read_image` does it. Of a mask
    that is black all over alpha alone counts.

    Raises:
        CaptureError: as `read_image`.
    """
    image = read_image(path, camera)
    colors = image[..., :3].any(axis=-1)
    if image.shape[2] == 3:
        return colors
    opaque = image[..., 3] > 0
    return colors & opaque if colors.any() else opaque & ~opaque.all()


def resize_image(
    image: UInt8[np.ndarray, "H W C"], width: int, height: int
) -> UInt8[np.ndarray, "h w C"]:
    """Reduce by area: each new pixel is the mean of the rectangle it covers, rounded.

    RGBA is averaged with colours weighted by alpha, so that what is transparent does not bleed.
    """
    if image.shape[:2] == (height, width):
        return image
    if image.shape[2] == 3:
        return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    weighted = image.astype(np.float32)
    weighted[..., :3] *= weighted[..., 3:] / 255
    weighted = cv2.resize(weighted, (width, height), interpolation=cv2.INTER_AREA)
    weighted[..., :3] *= 255 / np.maximum(weighted[..., 3:], 1e-3)
    return np.rint(weighted).clip(0, 255).astype(np.uint8)


def resize_mask(mask: Bool[np.ndarray, "H W"], width: int, height: int) -> Bool[np.ndarray, "h w"]:
    """Reduce by area: True where at least half of the rectangle is True."""
    area = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return area >= 0.5


def _open(path: Path) -> Image.Image:
    """The file, not decoded yet. Raises CaptureError."""
    if not path.is_file():
        raise CaptureError(
            f"Image {path} does not exist. Check --data and the images folder, or remove the image "
            "from the reconstruction."
        )
    with suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()
    try:
        return Image.open(path)
    except UnidentifiedImageError as error:
        problem = "it is damaged, or of another format (HEIC needs `pip install pillow-heif`)"
        raise _unreadable(path, problem) from error
    except Exception as error:  # damage ends in errors of many kinds
        raise _unreadable(path, str(error)) from error


def _unreadable(path: Path, problem: str) -> CaptureError:
    reason = problem.strip().splitlines()[0] if problem.strip() else "no pixels in it"
    return CaptureError(
        f"Image {path} cannot be read: {reason}. Copy it again from its source, or remove it from "
        "the reconstruction (or from transforms.json)."
    )


def _orientation(image: Image.Image, camera: tuple[int, int] | None) -> int:
    """EXIF's, where it is followed, else 1."""
    try:  # by the base class: PNG's decodes all pixels to look behind them
        orientation = Image.Image.getexif(image).get(ExifTags.Base.Orientation, 1)
    except Exception:  # damaged tags end in errors of many kinds
        return 1
    is_camera = camera and (image.width > image.height) == (camera[0] > camera[1])
    if orientation not in range(2, 9) or is_camera or (camera and orientation < 5):
        return 1
    return orientation
