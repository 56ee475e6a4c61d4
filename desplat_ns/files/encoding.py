"""Pictures as bytes for a page that must not grow too large.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from desplat_ns.errors import ConfigError
from desplat_ns.files.pages import data_address

LADDER = (
    (1024, 82),
    (1024, 72),
    (800, 72),
    (640, 70),
    (640, 60),
    (512, 55),
    (400, 50),
    (320, 50),
    (240, 45),
    (160, 40),
)
"""Pixels of the longer side, at most, and WebP's quality: from what is best to what is smallest."""

LARGEST_SIDE = LADDER[0][0]
"""Pixels; no picture on a page is larger."""

SAMPLE = 12
"""Pictures by which it is judged whether all would fit."""


@dataclass(frozen=True)
class Picture:
    """A picture for the page."""

    pixels: UInt8[np.ndarray, "H W 3"]
    share: float = 1.0
    """Of the side that pictures may have: a picture that is shown smaller needs fewer pixels."""


@dataclass(frozen=True)
class Encoded:
    """Pictures as data addresses, in the order in which they were given."""

    sources: tuple[str, ...]
    side: int
    """Pixels of the longer side, at most."""
    quality: int
    """WebP's, up to 100."""

    @property
    def num_bytes(self) -> int:
        """Of all addresses together, as they stand in the page."""
        return sum(map(len, self.sources))


def fitted_into(pictures: Sequence[Picture], budget: int) -> Encoded:
    """Encode pictures as WebP, as large and as good as a number of bytes allows.

    Args:
        budget: bytes of all data addresses together.

    Raises:
        ConfigError: there are too many pictures even for the smallest size.
    """
    stride = max(1, len(pictures) // SAMPLE)
    sample = pictures[::stride]
    for side, quality in LADDER:
        if _size_of(sample, side, quality) * len(pictures) / max(1, len(sample)) > 1.1 * budget:
            continue
        sources = tuple(_address(picture, side, quality) for picture in pictures)
        encoded = Encoded(sources, side, quality)
        if encoded.num_bytes <= budget:
            return encoded
    raise ConfigError(
        f"{len(pictures)} pictures do not fit into a page of {budget / 1e6:.3g} MB, however small "
        "they are made. Ask for fewer: --training-photos 50 --held-out-photos 12."
    )


def _size_of(pictures: Sequence[Picture], side: int, quality: int) -> int:
    return sum(len(_address(picture, side, quality)) for picture in pictures)


def _address(picture: Picture, side: int, quality: int) -> str:
    return data_address(picture.pixels, max(1, round(side * picture.share)), quality, "WEBP")
