"""At which size photos are used: reduced copies where they are there, else reduced on reading."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nerfstudio.data.dataparsers.colmap_dataparser import MAX_AUTO_RESOLUTION

from desplat_ns.core.console import announce_once
from desplat_ns.data.images import image_size
from desplat_ns.data.photo_files import begin_folder, check_files
from desplat_ns.data.reconstruction import Frame

SIZE_TOLERANCE = 1
"""Pixels by which a reduced copy may differ from the photo's size over the factor, by rounding."""


@dataclass(frozen=True)
class PhotoSource:
    """A file, and the size at which it is used (it is reduced to it by area where it is larger)."""

    path: Path
    width: int
    height: int


def downscale_factor(requested: int | None, frame: Frame) -> float:
    """The requested factor, or the power of two by which a photo comes to at most 1600 pixels."""
    if requested is None:
        longest = max(frame.width, frame.height)
        return 2.0 ** max(0, math.ceil(math.log2(longest / MAX_AUTO_RESOLUTION)))
    return float(requested)


def photo_sources(
    images: Path, frames: Sequence[Frame], requested: int | None, rounding: str
) -> list[PhotoSource]:
    """Files of photos and their sizes in use, by `downscale_factor`; says once whence they are.
    Raises CaptureError where some are not there.

    A photo that is reduced is read from the folder beside `images` with the suffix `_factor`, if it
    is there at that size (`SIZE_TOLERANCE`), else from `images`. Nothing is written.
    """
    folders = {(images / frame.name).parent for frame in frames}
    entries = (path for folder in folders if folder.is_dir() for path in folder.iterdir())
    begin_folder(images, [path.name for path in entries if path.is_file()])
    sources, reduced = [], []
    for frame in frames:
        factor = downscale_factor(requested, frame)
        reduced += [factor] if factor > 1 else []
        sides = (reduced_length(side, factor, rounding) for side in (frame.width, frame.height))
        whole = PhotoSource(images / frame.name, *sides)
        sources.append(_copy_of(images, frame, factor) or whole)
    check_files([source.path for source in sources], images, "photos", "--images-path")
    if reduced:
        shares = ", ".join(f"1/{factor:g}" for factor in sorted(set(reduced)))
        copies = sum(not source.path.is_relative_to(images) for source in sources)
        announce_once(
            f"{len(reduced)} of {len(frames)} photos are used at {shares} of their size; "
            f"{copies} of them are read in smaller copies beside {images}."
        )
    return sources


def reduced_length(length: int, factor: int | float, rounding: str) -> int:
    """Pixels of a side over `factor`, at least 1; `rounding` is floor, round or ceil."""
    exact = length / factor
    rounded = {"floor": math.floor, "round": lambda x: math.floor(x + 0.5), "ceil": math.ceil}
    return max(1, rounded[rounding](exact))


def _copy_of(images: Path, frame: Frame, factor: float) -> PhotoSource | None:
    """The reduced copy of a photo, if it is there and of the size that it should have."""
    path = images.with_name(f"{images.name}_{factor:g}") / frame.name
    if factor <= 1 or not os.path.isfile(path):
        return None
    width, height = image_size(path, (frame.width, frame.height))
    off = max(abs(width - frame.width / factor), abs(height - frame.height / factor))
    return PhotoSource(path, width, height) if off <= SIZE_TOLERANCE else None
