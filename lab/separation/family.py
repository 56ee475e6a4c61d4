"""What passes, and what stands still, in the 29 photos of a walk round the bronze "Family".

The scene is Family of Tanks and Temples; the photos stay outside of the project. Polygons were
drawn by hand over the enlarged photos and fit to some 3 pixels; of the still things they are coarse
and lie well inside. Somebody whom a neighbouring photo shows elsewhere, or whose place another
photo shows empty, is a passer-by, with all that he carries. The light is even: what shadows there
are at their feet are too faint to outline.
"""

from pathlib import Path, PurePath

import cv2
import numpy as np
from jaxtyping import Bool

WIDTH, HEIGHT = 854, 474
"""Pixels of a photo, and of the polygons."""

PASSING = ("passer", "shadow")
"""Kinds that pass: people, what moves with them, a squirrel; the shadows of these."""

UNSURE = "unsure"
"""What may move and may not: far crowds, traffic, those who wait, a parked bicycle."""

STILL = ("statue", "palm", "wall", "lawn", "trees")
"""Kinds of still things near the walk; the plinth belongs to the statue."""

Mask = Bool[np.ndarray, "H W"]


def _frames() -> dict[str, list[tuple[str, str]]]:
    """By frame: kinds, and the corners of a polygon each, x,y in pixels from the upper left."""
    frames: dict[str, list[tuple[str, str]]] = {}
    for line in Path(__file__).with_suffix(".txt").read_text("utf8").splitlines():
        frame, kind, corners = line.split(" ", 2)
        frames.setdefault(frame, []).append((kind, corners))
    return frames


FRAMES = _frames()
"""`family.txt` has a line for each polygon."""


def _drawn(name: str, kinds: tuple[str, ...], width: int, height: int) -> Mask:
    """Where a frame has polygons of these kinds, at that size: at least half of a pixel."""
    canvas = np.zeros((HEIGHT, WIDTH), np.float32)
    for kind, points in FRAMES[PurePath(name).stem]:
        if kind in kinds:
            corners = [[int(n) for n in point.split(",")] for point in points.split()]
            cv2.fillPoly(canvas, [np.array(corners, np.int32)], (1.0,))
    return cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA) >= 0.5


def masks(name: str, width: int = WIDTH, height: int = HEIGHT) -> Mask:
    """Passers-by and their shadows in a photo (`001.jpg` or `001`), at a size in pixels."""
    return _drawn(name, PASSING, width, height)


def unsure(name: str, width: int = WIDTH, height: int = HEIGHT) -> Mask:
    """What no score should count; without what certainly passes."""
    return _drawn(name, (UNSURE,), width, height) & ~masks(name, width, height)


def still(name: str, width: int = WIDTH, height: int = HEIGHT) -> dict[str, Mask]:
    """Still things by their kind, without who passes before them; those that the frame shows."""
    counted = ~(masks(name, width, height) | unsure(name, width, height))
    drawn = {kind: _drawn(name, (kind,), width, height) & counted for kind in STILL}
    return {kind: mask for kind, mask in drawn.items() if mask.any()}
