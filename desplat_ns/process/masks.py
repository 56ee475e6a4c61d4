"""Masks that keep features off what is in most photos: a watermark, a dashboard, a selfie stick."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from desplat_ns.console import list_names
from desplat_ns.data.images import read_mask, resize_mask, write_image
from desplat_ns.data.photo_files import photo_names
from desplat_ns.errors import CaptureError
from desplat_ns.process.photos import Photo


def prepare_masks(mask: Path, photos: Sequence[Photo], copies: Path) -> int:
    """Write `copies`/COPY.png for each photo that has a mask: black where no feature may be.

    Args:
        mask: a picture for all photos, or a folder with one for each, named as the photo, with any
            ending (`a.png` or `a.jpg.png` for `a.jpg`).

    Returns:
        How many photos have one.

    Raises:
        CaptureError: none has one, or one has another shape than its photo, or cannot be read.
    """
    stems = _stems(mask)
    found = {photo: path for photo in photos if (path := _mask_of(photo, mask, stems))}
    if not found:
        raise CaptureError(
            f"No mask in {mask} belongs to a photo (it has {list_names(photo_names(mask), 5)}). "
            f"Needed are files named as the photos: {Path(photos[0].source).stem}.png for "
            f"{photos[0].source}; or name one picture that is the mask of all."
        )
    copies.mkdir(parents=True, exist_ok=True)
    for photo, path in found.items():
        write_image(copies / f"{photo.copy}.png", _of_size(read_mask(path), photo, path))
    return len(found)


def _stems(mask: Path) -> dict[str, Path]:
    """Masks by their path without endings, in lower case."""
    if mask.is_file():
        return {}
    return {
        str(PurePosixPath(name).with_suffix("")).lower(): mask / name for name in photo_names(mask)
    }


def _mask_of(photo: Photo, mask: Path, stems: dict[str, Path]) -> Path | None:
    if mask.is_file():
        return mask
    name = photo.source.lower()
    return stems.get(name) or stems.get(str(PurePosixPath(name).with_suffix("")))


def _of_size(mask: np.ndarray, photo: Photo, path: Path) -> np.ndarray:
    height, width = mask.shape
    if abs(width / height - photo.width / photo.height) > 0.02 * width / height:
        raise CaptureError(
            f"Mask {path} has {width}x{height} pixels, {photo.source} is of another shape "
            f"({photo.width}x{photo.height} as used). Make it of the photo's size."
        )
    if width < photo.width:
        rows = np.arange(photo.height) * height // photo.height
        columns = np.arange(photo.width) * width // photo.width
        return mask[np.ix_(rows, columns)]
    return resize_mask(mask, photo.width, photo.height)
