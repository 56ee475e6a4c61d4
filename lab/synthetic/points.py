"""What structure from motion would have found: coloured points and where each was seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from lab.synthetic.cameras import PinholeCamera

_SAME_SURFACE = 0.015
"""A point is seen where its depth agrees with the picture's to this fraction."""

FEW_VIEWS = 3
"""Points seen in fewer views than this are dropped, as COLMAP drops short tracks."""

FAINT = 1.5
"""Of 255 per pixel: corners fainter than this are not found again in other photos."""


View: TypeAlias = tuple[PinholeCamera, UInt8[np.ndarray, "_ _ 3"], Float[np.ndarray, "_ _"]]
"""Camera, picture without occluders, and its depth in metres."""


@dataclass(frozen=True)
class PointCloud:
    """Points on visible surfaces; world units are metres."""

    xyz: Float[np.ndarray, "3 N"]
    """True positions."""
    rgb: UInt8[np.ndarray, "3 N"]
    is_seen: Bool[np.ndarray, "V N"]
    """Whether a view shows the point when nothing stands before it."""
    rows: Int[np.ndarray, "V N"]
    """Row of the pixel at which a view shows the point; 0 where it does not."""
    columns: Int[np.ndarray, "V N"]

    def hidden_by(self, view: int, mask: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, " N"]:
        """Which of the points that a view shows lie under `mask`."""
        return self.is_seen[view] & mask[self.rows[view], self.columns[view]]

    def keep(self, which: Int[np.ndarray, " M"]) -> "PointCloud":
        """Some of the points."""
        return PointCloud(*(array[:, which] for array in vars(self).values()))


def slopes(image: UInt8[np.ndarray, "H W 3"], bare: float) -> Float[np.ndarray, "H W"]:
    """How steep the grey values are, of 255 per pixel; `bare` is added everywhere."""
    down, across = np.gradient(image.astype(np.float64).mean(axis=2))
    return np.hypot(down, across) + bare


def corners(image: UInt8[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W"]:
    """The same in the direction in which the grey values around a pixel change least.

    The root of the smaller eigenvalue of the mean of g g^T, with g the slope, over 3 x 3 pixels:
    what tells a place that can be found again from a bare surface and from a straight edge.
    """
    down, across = np.gradient(image.astype(np.float64).mean(axis=2))
    xx, yy, xy = (_mean_around(p) for p in (across * across, down * down, across * down))
    return np.sqrt(np.maximum((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 0.0))


def _mean_around(values: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "H W"]:
    padded = np.pad(values, 1, mode="edge")
    height, width = values.shape
    shifted = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.sum(shifted, axis=0) / 9


def sample_pixels(
    image: UInt8[np.ndarray, "H W 3"],
    count: int,
    rng: np.random.Generator,
    bare: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of `count` pixels, likelier where the picture has structure.

    Args:
        bare: the slope (of 255 per pixel) that a place without structure counts as; None: only
            `corners` count, less those below `FAINT`.
    """
    weight = slopes(image, bare) if bare is not None else np.maximum(corners(image) - FAINT, 0.0)
    chosen = rng.choice(weight.size, size=count, p=(weight / weight.sum()).ravel())
    rows, columns = np.unravel_index(chosen, weight.shape)
    return rows, columns


def lift(
    camera: PinholeCamera, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray
) -> Float[np.ndarray, "3 N"]:
    """World points at `depth` (metres) behind the centres of pixels."""
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
    local = np.linalg.inv(camera.K) @ pixels * depth
    return camera.viewmat[:3, :3].T @ (local - camera.viewmat[:3, 3:])


def sees(
    camera: PinholeCamera, depth: Float[np.ndarray, "H W"], xyz: Float[np.ndarray, "3 N"]
) -> tuple[Bool[np.ndarray, " N"], np.ndarray, np.ndarray]:
    """Which points a view shows, and the row and column at which (0 for the others)."""
    (x, y), z = camera.project(xyz)
    with np.errstate(invalid="ignore"):
        inside = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    columns, rows = np.where(inside, x, 0).astype(int), np.where(inside, y, 0).astype(int)
    return inside & (np.abs(depth[rows, columns] - z) < _SAME_SURFACE * z), rows, columns


def sample_points(
    views: Sequence[View], count: int, rng: np.random.Generator, bare: float | None
) -> PointCloud:
    """`count` points, or as many as can be had, each seen by three of `views` or more.

    Args:
        bare: see `sample_pixels`.
    """
    per_view = -(-count * 5 // (4 * len(views)))
    xyz, rgb = [], []
    for camera, image, depth in views:
        rows, columns = sample_pixels(image, per_view, rng, bare)
        on_surface = np.isfinite(depth[rows, columns])
        rows, columns = rows[on_surface], columns[on_surface]
        xyz.append(lift(camera, rows, columns, depth[rows, columns]))
        rgb.append(image[rows, columns].T)
    points = np.concatenate(xyz, axis=1)
    sightings = [
        np.stack(part) for part in zip(*(sees(c, d, points) for c, _, d in views), strict=True)
    ]
    cloud = PointCloud(points, np.concatenate(rgb, axis=1), *sightings)
    tracked = np.flatnonzero(cloud.is_seen.sum(axis=0) >= FEW_VIEWS)
    return cloud.keep(np.sort(rng.permutation(tracked)[:count]))


def mean_colors(
    cloud: PointCloud, images: Sequence[UInt8[np.ndarray, "_ _ 3"]]
) -> UInt8[np.ndarray, "3 N"]:
    """Each point's colour, averaged over the pictures that see it: one picture for each view."""
    total = np.zeros(cloud.rgb.shape)
    for visible, rows, columns, image in zip(
        cloud.is_seen, cloud.rows, cloud.columns, images, strict=True
    ):
        total += np.where(visible, image[rows, columns].T, 0)
    return np.round(total / cloud.is_seen.sum(axis=0)).astype(np.uint8)
