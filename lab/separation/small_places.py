"""Where in a capture small things are pasted: far from one another, on ground of a wanted kind."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap
from jaxtyping import Float

from desplat_ns.data.images import read_image

CANDIDATES = 600
"""Places that are tried for each thing."""

CHOICE = 0.04
"""Of those that are possible, the place is any of this share that suits best."""

NEIGHBOURS = 2
"""In so many photos before and after, nothing else is pasted at the same place of the image."""

MOST_COVERED = 0.25
"""Share of the photos that see a point in which things may cover it, one photo apart."""

SMOOTH = 0.05
"""Ground with less deviation of grey (in [0, 1]) in a window of 1/20 of the photo is smooth."""

STEP = (0.7, 1.3)
"""A thing moves from photo to photo by so many of its widths."""

TILT = 0.35
"""Its direction is off the horizontal by up to this angle, radians."""


@dataclass(frozen=True)
class Place:
    """Where a thing stands in photos that follow each other."""

    names: tuple[str, ...]
    centers: tuple[tuple[int, int], ...]
    """Pixels."""
    angle: float
    """In which it moves, radians."""
    ground: str
    """`smooth` or `textured`."""


class Places:
    """The places of a capture that are still free."""

    def __init__(
        self,
        reconstruction: pycolmap.Reconstruction,
        images: Path,
        names: Sequence[str],
        rng: np.random.Generator,
    ) -> None:
        """`names`: of the training photos, in their order."""
        self.names, self.rng = list(names), rng
        self.detail = {name: _detail(images / name) for name in names}
        self.points = {
            image.name: _points(image, reconstruction)
            for image in reconstruction.images.values()
            if image.has_pose and image.name in self.detail
        }
        """x, y, depth and number of the points that each photo sees."""
        self.seen = Counter(i for p in self.points.values() for i in p[:, 3].astype(int).tolist())
        self.covered: Counter[int] = Counter()
        self.boxes: list[tuple[int, np.ndarray]] = []

    def find(self, kind: str, count: int, size: tuple[int, int], ground: str) -> Place | None:
        """A free place, which is taken with that; None where nothing is free.

        Args:
            kind: `cut` stands at the border, `far` before the farthest points.
            count: photos that follow each other.
            size: width and height of the thing, pixels.
        """
        suitable: list[tuple[float, int, np.ndarray, float]] = []
        for _ in range(CANDIDATES):
            first = int(self.rng.integers(len(self.names) - count + 1))
            centers, angle = self._walk(kind, count, size, first)
            if self._is_free(kind, first, centers, size):
                if kind == "far":
                    suits = self._depth(first, centers, size)
                else:
                    suits = self._mean_detail(first, centers, size)
                    suits = -suits if ground == "smooth" else suits
                suitable.append((suits, first, centers, angle))
        if not suitable:
            return None
        suitable.sort(key=lambda candidate: -candidate[0])
        chosen = self.rng.integers(max(1, round(CHOICE * len(suitable))))
        _, first, centers, angle = suitable[chosen]
        found = "smooth" if self._mean_detail(first, centers, size) < SMOOTH else "textured"
        for i, center in enumerate(centers):
            box = _around(center, size)
            self.boxes.append((first + i, box))
            self.covered.update(self._points_in(first + i, box)[:, 3].astype(int).tolist())
        names = tuple(self.names[first : first + count])
        return Place(names, tuple((int(x), int(y)) for x, y in centers), angle, found)

    def _walk(
        self, kind: str, count: int, size: tuple[int, int], first: int
    ) -> tuple[Float[np.ndarray, "count 2"], float]:
        """Centres along a straight line; of what is cut, along the left or right border."""
        height, width = self.detail[self.names[first]].shape
        angle = self.rng.uniform(-TILT, TILT) + math.pi * self.rng.integers(2)
        start = self.rng.uniform(0, 1, 2) * (width, height)
        if kind == "cut":
            angle, start[0] = math.pi / 2, width * self.rng.integers(2)
        step = self.rng.uniform(*STEP) * size[0] * np.array([math.cos(angle), math.sin(angle)])
        return np.round(start + np.arange(count)[:, None] * step), angle

    def _is_free(self, kind: str, first: int, centers: np.ndarray, size: tuple[int, int]) -> bool:
        """Inside photos of the same size, and away from what is there already."""
        shapes = {self.detail[name].shape for name in self.names[first : first + len(centers)]}
        if len(shapes) > 1:
            return False
        ((height, width),) = shapes
        half = np.array(size) / 2 + 2
        low, high = half, np.array([width, height]) - half
        if kind == "cut":
            low, high = low * (0, 1), high * (0, 1) + (width, 0)
        if ((centers < low) | (centers > high)).any():
            return False
        for i, center in enumerate(centers):
            box = _around(center, size)
            for photo, other in self.boxes:
                is_near = abs(photo - first - i) <= NEIGHBOURS
                if is_near and (box[:2] < other[2:]).all() and (other[:2] < box[2:]).all():
                    return False
            points = self._points_in(first + i, box)[:, 3].astype(int).tolist()
            worn = [self.covered[p] + 1 > max(1, MOST_COVERED * self.seen[p]) for p in points]
            if sum(worn) > 0.1 * len(points):
                return False
        return True

    def _points_in(self, photo: int, box: np.ndarray) -> Float[np.ndarray, "n 4"]:
        points = self.points[self.names[photo]]
        return points[((points[:, :2] >= box[:2]) & (points[:, :2] < box[2:])).all(axis=1)]

    def _depth(self, first: int, centers: np.ndarray, size: tuple[int, int]) -> float:
        """Median depth of the points there over that of the photo's; 0 where there are none."""
        depths = self._points_in(first, _around(centers[0], size))[:, 2]
        of_photo = self.points[self.names[first]][:, 2]
        return float(np.median(depths) / np.median(of_photo)) if len(depths) > 0 else 0.0

    def _mean_detail(self, first: int, centers: np.ndarray, size: tuple[int, int]) -> float:
        means = []
        for i, (x, y) in enumerate(centers):
            detail = self.detail[self.names[first + i]]
            rows = slice(max(0, int(y - size[1] / 2)), int(y + size[1] / 2))
            columns = slice(max(0, int(x - size[0] / 2)), int(x + size[0] / 2))
            means.append(detail[rows, columns].mean())
        return float(np.mean(means))


def _around(center: np.ndarray, size: tuple[int, int]) -> Float[np.ndarray, "4"]:
    """Left, top, right and bottom of a thing, with half of its width around it."""
    half = np.array(size) / 2 + max(4, size[0] / 2)
    return np.concatenate([center - half, center + half])


def _detail(path: Path) -> Float[np.ndarray, "H W"]:
    """Deviation of grey in a window around each pixel."""
    gray = read_image(path)[..., :3].mean(axis=-1).astype(np.float32) / 255
    side = max(3, gray.shape[1] // 20)
    mean, square = cv2.blur(gray, (side, side)), cv2.blur(gray * gray, (side, side))
    return np.sqrt(np.maximum(square - mean * mean, 0))


def _points(
    image: pycolmap.Image, reconstruction: pycolmap.Reconstruction
) -> Float[np.ndarray, "n 4"]:
    pose, rows = image.cam_from_world(), []
    for point in image.points2D:
        if point.has_point3D():
            depth = (pose * reconstruction.points3D[point.point3D_id].xyz)[2]
            rows.append((*point.xy, depth, point.point3D_id))
    return np.array(rows, np.float64).reshape(-1, 4)
