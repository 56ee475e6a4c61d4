"""The ellipse within which a Gaussian can be seen, and the tiles and rows that it touches.

A Gaussian with opacity o, mean m and conic (a, b, c) has at offset d = (x, y) from m

    alpha(d) = o exp(-sigma),    sigma = (a x^2 + 2 b x y + c y^2) / 2,

so it is skipped (alpha < ALPHA_CUTOFF) outside the ellipse sigma <= s, s = log(o / ALPHA_CUTOFF).
The ellipse is convex: the part of it between two parallel lines casts one interval as its shadow
along them, and a tile is touched exactly if its pixel columns meet the shadow of its row of tiles.
With D = a c - b^2, at height y the ellipse reaches from left(y) to right(y),

    right(y), left(y) = -(b/a) y +- sqrt(2 s/a - (D/a^2) y^2),    |y| <= sqrt(2 s a/D),

where right is concave with its top at y = -(b/c) sqrt(2 s c/D), and left is its mirror image. The
shadow is right at the height nearest to its top, and likewise left: two square roots per row of
tiles, and the same again with x and y exchanged for the rows that a block of columns needs inside a
tile.
"""

import math
from typing import NamedTuple

import numpy as np

from desplat_ns.backend.numba_kernels.runtime import part

TILE = 16
"""Width and height of a tile in pixels. 16 was measured faster than 8 and 32."""

BLOCK = 8
"""Columns of a tile that share one range of rows: eight float32, one vector register."""

BLOCKS = TILE // BLOCK

PAIR = 2 * BLOCK
"""Pixels of two rows of a block. The rows that an entry looks at start and end at even ones: 512
bits are two rows, and a third by itself took a loop of its own and sums as long as the others'."""

MEAN_X, MEAN_Y, CONIC_A, CONIC_B, CONIC_C, OPACITY, FEATURES = range(7)
"""Places in the record of a visible Gaussian."""

RECORD = FEATURES + 4
"""Numbers of a record: the features are three colours and the depth."""

OUTLINE = 7
"""Numbers that are kept of an `Ellipse`: mean x, y; slope_y, extent_x, root_y, bend_y, top_y."""

BATCH = 64
"""Entries whose rows are worked out together."""

SLACK = 2e-5
"""Added to s, which is about 1: float32 rounding of alpha at the cutoff decides, not the lists."""

EASE, RELATIVE_EASE = np.float32(2e-3), np.float32(1e-6)
"""The rows of an entry are extended by so many pixels, for the same reason: they are worked out in
float32, whose rounding (6e-8) a few operations enlarge."""

_O1, _O2, _O3, _O4, _O5, _O6 = (np.uint64(BATCH * k) for k in range(1, 7))

_ZERO = np.float32(0)


class Ellipse(NamedTuple):
    """left, right = -slope_x y -+ sqrt(root_x - bend_x y^2), |y| <= extent_y; right is largest at
    y = top_x. The same with x and y exchanged. All float64."""

    mean_x: np.float64
    mean_y: np.float64
    slope_x: np.float64
    slope_y: np.float64
    extent_x: np.float64
    extent_y: np.float64
    root_x: np.float64
    root_y: np.float64
    bend_x: np.float64
    bend_y: np.float64
    top_x: np.float64
    top_y: np.float64


@part()
def ellipse(records, base, cutoff):
    """The visible ellipse in float64; where it is degenerate, one without bounds."""
    a = np.float64(records[base + CONIC_A])
    b = np.float64(records[base + CONIC_B])
    c = np.float64(records[base + CONIC_C])
    s = np.log(np.float64(records[base + OPACITY]) / cutoff) + SLACK
    det = a * c - b * b
    extent_x = extent_y = root_x = root_y = np.float64(np.inf)
    bend_x = bend_y = top_x = top_y = np.float64(0)
    if det > 0:
        extent_x, extent_y = np.sqrt(2 * s * c / det), np.sqrt(2 * s * a / det)
        root_x, root_y = 2 * s / a, 2 * s / c
        bend_x, bend_y = det / (a * a), det / (c * c)
        top_x, top_y = -b / c * extent_x, -b / a * extent_y
    mean_x, mean_y = np.float64(records[base + MEAN_X]), np.float64(records[base + MEAN_Y])
    slope_x, slope_y = b / a, b / c
    axes = (slope_x, slope_y, extent_x, extent_y, root_x, root_y, bend_x, bend_y, top_x, top_y)
    return Ellipse(mean_x, mean_y, *axes)


@part()
def shadow(low, high, slope, extent, root, bend, top):
    """Shadow of the ellipse between two offsets across the axis; (1, 0) if there is none."""
    low, high = max(low, -extent), min(high, extent)
    if low > high:
        return 1.0, 0.0
    at = min(max(top, low), high)
    right = -slope * at + math.sqrt(max(root - bend * at * at, 0.0))
    at = min(max(-top, low), high)
    left = -slope * at - math.sqrt(max(root - bend * at * at, 0.0))
    return left, right


@part()
def pixels(mean, low, high, first, end):
    """Pixels of [first, end) whose centres lie in mean + [low, high], as (start, stop)."""
    start = math.ceil(min(max(mean + low - 0.5, np.float64(first)), np.float64(end)))
    stop = math.floor(min(max(mean + high - 0.5, np.float64(first - 1)), np.float64(end - 1))) + 1
    return np.int64(start), np.int64(stop)


@part()
def columns(e, ty, grid):
    """Pixel columns (start, stop) that the ellipse covers in the ty-th row of tiles."""
    low = ty * TILE + 0.5 - e.mean_y
    high = min((ty + 1) * TILE, grid.height) - 0.5 - e.mean_y
    left, right = shadow(low, high, e.slope_x, e.extent_y, e.root_x, e.bend_x, e.top_x)
    if left > right:
        return 0, 0
    return pixels(e.mean_x, left, right, 0, grid.width)


@part()
def tile_rows(e, grid):
    """Rows of tiles (first, end) within the ellipse's height."""
    first, stop = pixels(e.mean_y, -e.extent_y, e.extent_y, 0, grid.height)
    return first // TILE, max((stop + TILE - 1) // TILE, first // TILE)


@part()
def block_rows(s, number, left, low, high, row_ranges, first, end):
    """Rows that the gathered outlines cover in one block of columns, in pairs; `shadow` for
    vectors.

    The arrays in `s` are the numbers of an outline. Written without branches.
    """
    near, far = np.float32(0.5), np.float32(BLOCK - 0.5)
    for k in range(np.uint64(number)):
        x, extent = left - s[k], s[k + _O3]
        x0, x1 = max(x + near, -extent), min(x + far, extent)
        at = min(max(s[k + _O6], x0), x1)
        top = np.sqrt(max(s[k + _O4] - s[k + _O5] * at * at, _ZERO)) - s[k + _O2] * at
        at = min(max(-s[k + _O6], x0), x1)
        bottom = -np.sqrt(max(s[k + _O4] - s[k + _O5] * at * at, _ZERO)) - s[k + _O2] * at
        ease = EASE + RELATIVE_EASE * (abs(s[k + _O1]) + abs(s[k + _O2]) * (abs(s[k]) + left))
        bottom = min(max(bottom + s[k + _O1] - near - low - ease, _ZERO), high - low)
        top = min(max(top + s[k + _O1] + near - low + ease, _ZERO), high - low)
        start, stop = np.int32(np.ceil(bottom)), np.int32(np.floor(top))
        meets = (x0 <= x1) & (start < stop)
        start, stop = start & np.int32(-2), (stop + np.int32(1)) & np.int32(-2)
        row_ranges[first + k] = np.uint8(start if meets else 0)
        row_ranges[end + k] = np.uint8(stop if meets else 0)
