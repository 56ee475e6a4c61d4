"""HEIC, the format in which iPhones keep photos: read by pillow-heif, an extra.

OpenImageIO's wheel is built without it. Letters in shapes: H x W pixels.
"""

from __future__ import annotations

from numbers import Rational
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from desplat_ns.errors import CaptureError

SUFFIXES = frozenset((".heic", ".heif", ".hif"))
BRANDS = frozenset((b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1"))
"""Of ISO 23008-12, at the beginning of a file."""

_EXIF, _TAGS = 0x8769, {"Make": 0x010F, "Model": 0x0110}
_EXIF_TAGS = {
    "Exif:LensModel": 0xA434,
    "Exif:FocalLength": 0x920A,
    "Exif:FocalLengthIn35mmFilm": 0xA405,
}


def is_heic(path: Path) -> bool:
    """By its beginning, whatever it is called; what cannot be looked at, by its name."""
    try:
        with path.open("rb") as file:
            begins = file.read(12)
    except OSError:
        begins = b""
    if begins:
        return begins[4:8] == b"ftyp" and begins[8:12] in BRANDS
    return path.suffix.lower() in SUFFIXES


def read_heic(path: Path) -> UInt8[np.ndarray, "H W 3"]:
    """The photo, upright.

    Raises:
        CaptureError: pillow-heif is not installed, or the file is damaged.
    """
    try:
        return np.asarray(_opened(path).to_pillow().convert("RGB"))
    except (OSError, ValueError, RuntimeError) as error:
        raise _unreadable(path, error) from error


def heic_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of the upright photo, not decoded. Raises as `read_heic`."""
    width, height = _opened(path).size
    return width, height


def heic_tags(path: Path) -> dict[str, object]:
    """What the file says of camera and lens, by OpenImageIO's names. Raises as `read_heic`."""
    tags = Image.Exif()
    tags.load(_opened(path).info.get("exif") or b"")
    inner = tags.get_ifd(_EXIF)
    values = {name: tags.get(number) for name, number in _TAGS.items()}
    values |= {name: inner.get(number) for name, number in _EXIF_TAGS.items()}
    return {
        name: float(value) if isinstance(value, Rational) else value
        for name, value in values.items()
        if value
    }


def _opened(path: Path) -> Any:
    try:
        import pillow_heif
    except ImportError as error:
        raise CaptureError(
            f"Image {path} is HEIC, as iPhones write it. To read it: pip install "
            "pillow-heif. Or convert the photos to JPEG."
        ) from error
    try:
        return pillow_heif.open_heif(path)
    except (OSError, ValueError, RuntimeError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> CaptureError:
    return CaptureError(
        f"Image {path} cannot be read: {error}. Copy it again from its source, or remove it."
    )
