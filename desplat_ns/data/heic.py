"""HEIC, the format in which iPhones keep photos: read by pillow-heif, an extra.

OpenImageIO's wheel is built without it. Letters in shapes: H x W pixels.
"""

from __future__ import annotations

from numbers import Rational
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from desplat_ns.errors import CaptureError

SUFFIXES = frozenset((".heic", ".heif", ".hif"))

_EXIF, _TAGS = 0x8769, {"Make": 0x010F, "Model": 0x0110}
_EXIF_TAGS = {
    "Exif:LensModel": 0xA434,
    "Exif:FocalLength": 0x920A,
    "Exif:FocalLengthIn35mmFilm": 0xA405,
}


def is_heic(path: Path) -> bool:
    """By its name's ending."""
    return path.suffix.lower() in SUFFIXES


def read_heic(path: Path) -> UInt8[np.ndarray, "H W 3"]:
    """The photo, upright.

    Raises:
        CaptureError: pillow-heif is not installed, or the file is missing, damaged or no HEIC.
    """
    with _opened(path) as image:
        try:
            return np.asarray(image.convert("RGB"))
        except (OSError, ValueError, RuntimeError) as error:
            raise _unreadable(path, error) from error


def heic_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of the upright photo. Raises as `read_heic`."""
    with _opened(path) as image:
        return image.size


def heic_tags(path: Path) -> dict[str, object]:
    """What the file says of camera and lens, by OpenImageIO's names. Raises as `read_heic`."""
    with _opened(path) as image:
        tags = image.getexif()
        inner = tags.get_ifd(_EXIF)
    found = {name: tags.get(number) for name, number in _TAGS.items()}
    found |= {name: inner.get(number) for name, number in _EXIF_TAGS.items()}
    return {
        name: float(value) if isinstance(value, Rational) else value
        for name, value in found.items()
        if value
    }


def _opened(path: Path) -> Image.Image:
    try:
        import pillow_heif
    except ImportError as error:
        raise CaptureError(
            f"Image {path} is HEIC, as iPhones write it. To read it: pip install "
            "'desplat-ns[heic]'. Or convert the photos to JPEG."
        ) from error
    try:
        return pillow_heif.open_heif(path).to_pillow()
    except (OSError, ValueError, RuntimeError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> CaptureError:
    return CaptureError(
        f"Image {path} cannot be read: {error}. Copy it again from its source, or remove it."
    )
