"""A capture in which some photos have a light of their own, for which nothing stands in the way.

The same light falls on a view's `clutter_` and `clean_` photo; masks stay as they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from desplat_ns.data.images import read_image, write_image

FLARES = 3
"""Every so many-th photo has a flare, ..."""

EXPOSURES = (1.15, 0.87)
"""... and of those after it one is exposed more and the next less, by these factors."""

STRENGTH = (0.2, 0.45)
"""What a flare adds in its middle, in colours in [0, 1]."""

RADIUS = (0.15, 0.35)
"""Distance in which it falls to exp(-1/2), in units of the photo's longer side."""


def light_some(scene: Path, folder: Path) -> None:
    """Write the capture of `scene` with light of single photos into `folder`.

    Args:
        scene: a capture of `clean_`, `clutter_` and `extra_` photos in images/, with sparse/ and
            masks/. The `extra_` photos stay as they are.
    """
    (folder / "images").mkdir(parents=True)
    for name in ("sparse", "masks"):
        (folder / name).symlink_to(scene / name)
    rng = np.random.default_rng(21)
    for path in (scene / "images").glob("extra_*"):
        (folder / "images" / path.name).symlink_to(path)
    for index, path in enumerate(sorted((scene / "images").glob("clutter_*"))):
        light = _flare(read_image(path).shape, rng)
        for name in (path.name, path.name.replace("clutter", "clean")):
            photo = read_image(scene / "images" / name) / 255.0
            turn = index % FLARES
            lit = photo + light if turn == 0 else photo * EXPOSURES[turn - 1]
            write_image(folder / "images" / name, _to_uint8(lit))


def _flare(shape: tuple[int, ...], rng: np.random.Generator) -> Float[np.ndarray, "H W 3"]:
    """Soft coloured light around a place in the picture."""
    height, width = shape[:2]
    longer = max(height, width)
    rows, columns = np.indices((height, width)) + 0.5
    down, across = (rng.uniform(0.1, 0.9) * side for side in (height, width))
    radius = rng.uniform(*RADIUS) * longer
    glow = np.exp(-((rows - down) ** 2 + (columns - across) ** 2) / (2 * radius**2))
    color = rng.uniform(0.3, 1.0, 3)
    return rng.uniform(*STRENGTH) * glow[..., None] * color / color.max()


def _to_uint8(colors: Float[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 3"]:
    return (colors.clip(0, 1) * 255).round().astype(np.uint8)
