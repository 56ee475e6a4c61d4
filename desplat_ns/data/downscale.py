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
    """The requested factor, or nerfstudio's power of two: photos come to at most 1600 pixels."""
    if requested is None:
        longest = max(max(frame.width, frame.height) for frame in frames)
        return 2.0 ** max(0, math.ceil(math.log2(longest / MAX_AUTO_RESOLUTION)))
    return float(requested)


def photo_sources(
    images: Path, frames: Sequence[Frame], factors: Sequence[float], rounding: Rounding
) -> tuple[list[PhotoSource], str]:
    """Files and sizes of photos, each at 1/factor of its size, and a line that says whence.

    Folders beside `images` with the suffix `_factor` are used if they hold every photo that is
    reduced, at that size (`SIZE_TOLERANCE`). Otherwise the photos in `images` are named with the
    reduced size. Nothing is written.
    """
    sources, copies, folders = [], [], {}
    for frame, factor in zip(frames, factors, strict=True):
        sides = (reduced_length(side, factor, rounding) for side in (frame.width, frame.height))
        sources.append(PhotoSource(images / frame.name, *sides))
        if factor > 1:
            folder = folders.setdefault(factor, images.parent / f"{images.name}_{factor:g}")
            copies.append(_copy_of(folder / frame.name, frame, factor))
    if not copies:
        return sources, ""
    found, places = len(copies) - copies.count(None), ", ".join(map(str, folders.values()))
    what = f"{len(copies)} of {len(frames)} photos are"
    if found == len(copies):
        taken = iter(copies)
        pairs = zip(sources, factors, strict=True)
        sources = [next(taken) if factor > 1 else source for source, factor in pairs]
        return sources, f"{what} read in smaller copies from {places}."
    shares = ", ".join(f"1/{factor:g}" for factor in sorted(folders))
    note = f" ({places} has {found})" if any(map(Path.is_dir, folders.values())) else ""
    return sources, f"{what} reduced to {shares} of their size while reading{note}."


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
