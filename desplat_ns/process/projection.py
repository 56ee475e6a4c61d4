"""Pictures that are no perspective views: all around in 360 degrees, or the two circles of a dual
fisheye. COLMAP gives them poses that are off by tenths of the scene.

Letters in shapes: H x W pixels.
"""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from desplat_ns.errors import CaptureError

PANORAMA = re.compile(rb"""GPano:ProjectionType\s*(=\s*["']|>)\s*(?!rectilinear|perspective)\w""")
"""In XMP, which stands as text in files of any format."""
LOOKED_AT = (512, 256)
"""Pixels in width and height at which pictures are looked at."""
FINE = 15
"""Pixels: what is finer than that is detail."""
ALIKE, DETAIL, POLES = 0.4, 1.5, 0.8
"""36 pictures of nine real surroundings have at least 0.63, at least 3.9, and at most 0.68; of 337
crops of photos none has more than 0.31 of the first."""
DARK = 24
"""Of 255: black, with a sensor's noise and a lens's flare."""


def check_projection(path: Path, image: UInt8[np.ndarray, "H W C"]) -> None:
    """Make sure that a photo may be a perspective view.

    Raises:
        CaptureError: it is none; says what to do.
    """
    small = cv2.resize(image[..., :3], LOOKED_AT, interpolation=cv2.INTER_AREA).astype(np.float32)
    is_wide = abs(image.shape[1] - 2 * image.shape[0]) <= 0.005 * image.shape[1]
    if is_wide and shows_two_circles(small):
        raise CaptureError("two fisheye circles: make perspective views with the camera's program")
    if (is_wide and wraps_around(small)) or PANORAMA.search(path.read_bytes()):
        raise CaptureError(
            "a 360-degree picture or panorama: split it into perspective views, for example with "
            "nerfstudio's `ns-process-data images` or `video` and `--camera-type equirectangular`"
        )


def wraps_around(small: Float32[np.ndarray, "256 512 3"]) -> bool:
    """Whether left and right edge continue each other in many details, and top and bottom row, each
    one point of a sphere, vary less than others. A table's edge at equal heights on both sides is
    no evidence by itself: what stands out is clipped."""
    edges = small[:, [0, -1]]
    details = (edges - cv2.blur(edges, (1, FINE))).transpose(1, 0, 2).reshape(2, -1)
    most = np.quantile(np.abs(details), 0.75, axis=1, keepdims=True)
    if most.min() < DETAIL:
        return False
    alike = np.corrcoef(details.clip(-most, most))[0, 1]
    rows = np.abs(small - small.mean(axis=1, keepdims=True)).mean(axis=(1, 2))
    return bool(alike > ALIKE and rows[0] + rows[-1] < POLES * np.median(rows))


def shows_two_circles(small: Float32[np.ndarray, "256 512 3"]) -> bool:
    """Whether both halves are bright in a ring and black outside of the circle that fills them."""
    y, x = np.mgrid[-1:1:256j, -1:1:256j]
    radius, bright = np.hypot(x, y), small.max(axis=2) > DARK
    ring, outside = (radius > 0.6) & (radius < 0.9), radius > 1.1
    halves = bright[:, :256], bright[:, 256:]
    return all(half[ring].mean() > 0.6 and half[outside].mean() < 0.05 for half in halves)
