"""At which size photos are used: reduced copies where they are there, else reduced on reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nerfstudio.data.dataparsers.colmap_dataparser import MAX_AUTO_RESOLUTION

from desplat_ns.data.images import image_size
from desplat_ns.data.reconstruction import Frame
from desplat_ns.errors import ConfigError

Rounding = Literal["floor", "round", "ceil"]

SIZE_TOLERANCE = 1
"""Pixels by which a reduced copy may differ from the photo's size over the factor: programs that
make `images_2` folders round differently."""


@dataclass(frozen=True)
class PhotoSource:
    """A file, and the size at which it is used (it is reduced to it by area where it is larger)."""

    path: Path
    width: int
    height: int


def downscale_factor(requested: int | float | None, frames: Sequence[Frame]) -> float:
    """The requested factor, or the power of two that brings all photos to <= 1600 px (nerfstudio).

    Raises:
        ConfigError: the requested factor is below 1 or not a number.
    """
    if requested is None:
        longest = max(max(frame.width, frame.height) for frame in frames)
        return 2.0 ** max(0, math.ceil(math.log2(longest / MAX_AUTO_RESOLUTION)))
    if not (math.isfinite(requested) and requested >= 1):
        raise ConfigError(
            f"--downscale-factor is {requested}; it must be 1 (full size) or more, for example 2."
        )
    return float(requested)


def photo_sources(
    images: Path, frames: Sequence[Frame], factor: int | float, rounding: Rounding
) -> tuple[list[PhotoSource], str]:
    """Files and sizes of photos at 1/`factor` of their size, and a line that says whence.

    A folder beside `images` with the suffix `_factor` is used if it holds every photo at that size
    (`SIZE_TOLERANCE`). Otherwise the photos in `images` are named with the reduced size. Nothing
    is written.
    """
    sources = [
        PhotoSource(
            images / frame.name,
            reduced_length(frame.width, factor, rounding),
            reduced_length(frame.height, factor, rounding),
        )
        for frame in frames
    ]
    if factor == 1:
        return sources, ""
    folder = images.parent / f"{images.name}_{factor:g}"
    copies = [_copy_of(folder / frame.name, frame, factor) for frame in frames]
    ready = [copy for copy in copies if copy is not None]
    if len(ready) == len(frames):
        return ready, f"Photos at 1/{factor:g} of their size are read from {folder}."
    note = f" ({folder} has {len(ready)} of {len(frames)})" if folder.is_dir() else ""
    return sources, f"Photos are reduced to 1/{factor:g} of their size while reading{note}."


def reduced_length(length: int, factor: int | float, rounding: Rounding) -> int:
    """Pixels of a side over `factor`, at least 1."""
    exact = length / factor
    rounded = {"floor": math.floor, "round": lambda x: math.floor(x + 0.5), "ceil": math.ceil}
    return max(1, rounded[rounding](exact))


def _copy_of(path: Path, frame: Frame, factor: int | float) -> PhotoSource | None:
    """The reduced copy at `path`, if it is there and of the size that it should have."""
    if not path.is_file():
        return None
    width, height = image_size(path, (frame.width, frame.height))
    off = max(abs(width - frame.width / factor), abs(height - frame.height / factor))
    return PhotoSource(path, width, height) if off <= SIZE_TOLERANCE else None
