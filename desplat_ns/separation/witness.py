"""What other photos say of a place, whatever the scene has learned so far: a plane sweep.

A residual cannot tell something in the way from a place that the scene has not learned, or that few
photos show. Other photos can. The place is scene if two neighbours show the same as this photo at
some depth, unless most of the photos that look at the place show something else there. If others
look and no two of them agree with this photo at any depth, something may be in the way. If hardly
anybody else looks, nobody knows, and leaving the place out would teach nothing. Letters in shapes:
V views, P points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.rendering.near_plane import sampled
from desplat_ns.rendering.views import image_points, in_image, views_of

MAX_POINTS = 3000
"""Points of the reconstruction by which neighbours, depths and exposures are found."""

PLANES = 64
"""Depths that are tried, evenly spread in inverse depth, and one infinitely far away."""

NEAREST, FARTHEST = 0.5, 8.0
"""The depths reach from this share of the nearest point in view to this multiple of the farthest
one: the 1% and 99% quantiles count."""

NEIGHBOURS = 6
"""Other photos that are asked about one."""

BEST_ANGLE, WIDTHS = 8.0, (5.0, 12.0)
"""Degrees between the directions from which two photos see their common points: neighbours at
`BEST_ANGLE` are preferred, as nearer ones show something in the way before the same background and
farther ones show another side of the scene. Weights fall like Gaussians of these widths, below and
above it."""

COMMON_POINTS = 10
"""Photos with fewer common points are no neighbours."""

FARTHEST_ANGLE, LOOKERS, FEWEST_LOOKERS = 60.0, 40, 8
"""Photos up to `FARTHEST_ANGLE` degrees apart may dispute what two neighbours confirm. At most
`LOOKERS` of them are asked, and `FEWEST_LOOKERS` have to look at a place: a few may all be wrong.
"""

RADIUS = 1
"""Photos are compared over windows of 2 `RADIUS` + 1 cells."""

SURROUNDINGS = 5
"""Cells (an odd number) across, anywhere in which a photo may show a place without disputing it,
because the depth is not exact. Disputes are averaged over as many."""

LOOKED_AT = 0.5
"""Share of the planes at which two neighbours have to look at a cell."""

DARKEST = 8
"""Of 255: darker colours say nothing of the exposure."""


@dataclass(frozen=True)
class Looker:
    """A photo in cells, and its camera."""

    colors: UInt8[np.ndarray, "rows columns 3"]
    K: Float[np.ndarray, "3 3"]
    """Intrinsics, in cells."""
    viewmat: Float[np.ndarray, "4 4"]
    """World to camera, OpenCV axes."""


def unexplained(
    photo: Looker, others: Sequence[Looker], inverse_depths: Float[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """By how much each cell of a photo differs from what two others show, at the depth where they
    come nearest to it, colours in [0, 1]; and that depth, inverse.

    The difference is NaN where fewer than two others look at most of the depths: nobody knows. The
    second-best other counts, since the best one may show the same thing in the way; at a depth at
    which one alone looks, that one.

    Args:
        others: in the exposure of the photo.
        inverse_depths: of planes before the photo's camera, per world unit.

    Source: plane sweep of Collins 1996, with the mean absolute difference of colours.
    """
    rows, columns = photo.colors.shape[:2]
    least, looked = np.full((rows, columns), 255, np.uint8), np.zeros((rows, columns), int)
    at = np.zeros((rows, columns))
    opaque = _with_alpha(photo.colors)
    pictures = [_with_alpha(other.colors) for other in others]
    homographies = [_homographies(photo, other, inverse_depths) for other in others]
    for plane in range(len(inverse_depths)):
        best, second = np.full((2, rows, columns), 255, np.uint8)
        for (to_other, is_before), picture in zip(homographies, pictures, strict=True):
            if not is_before[plane]:
                continue
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            warped = cv2.warpPerspective(picture, to_other[plane], (columns, rows), flags=flags)
            # outside of the other photo alpha is 0, so the difference is 255
            red, green, blue, alpha = cv2.split(cv2.absdiff(warped, opaque))
            step = cv2.max(cv2.max(red, green), cv2.max(blue, alpha))
            step = cv2.blur(step, (2 * RADIUS + 1,) * 2)
            second = cv2.min(second, cv2.max(best, step))
            best = cv2.min(best, step)
        looked += second < 255
        second = np.where(second < 255, second, best)
        at[second < least] = inverse_depths[plane]
        least = cv2.min(least, second)
    is_known = looked >= LOOKED_AT * len(inverse_depths)
    return np.where(is_known, least / np.float32(255), np.float32(np.nan)), at


def disputed(
    photo: Looker, others: Sequence[Looker], inverse_depths: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """By how much each cell of a photo at least differs from what half of the others that look at
    its place show there, colours in [0, 1]; 0 where fewer than `FEWEST_LOOKERS` look.

    It is averaged over a cell's surroundings: parts of what is in the way may have the colours of
    what others see at their place.

    Args:
        others: in the exposure of the photo.
        inverse_depths: of the cells before the photo's camera, per world unit.
    """
    y, x = np.indices(inverse_depths.shape) + 0.5
    rays = np.tensordot(np.linalg.inv(photo.K), np.stack([x, y, np.ones_like(x)]), 1)
    places = np.concatenate([rays, inverse_depths[None]])
    window, near = (2 * RADIUS + 1,) * 2, np.ones((SURROUNDINGS,) * 2, np.uint8)
    own, steps = _with_alpha(cv2.blur(photo.colors, window)), []
    for other in others:
        to_other = other.K @ other.viewmat[:3] @ np.linalg.inv(photo.viewmat)
        *there, depth = np.tensordot(to_other, places, 1)
        ahead = np.maximum(depth, np.finfo(np.float32).tiny)
        at = [np.where(depth > 0, (uv / ahead - 0.5).clip(-9, 1e4), -9) for uv in there]
        u, v = np.stack(at).astype(np.float32)
        smooth = cv2.blur(other.colors, window)
        least, most = (
            cv2.remap(_with_alpha(end(smooth, near)), u, v, cv2.INTER_NEAREST)
            for end in (cv2.erode, cv2.dilate)
        )  # outside of the other photo alpha is 0, so the difference is 255
        steps.append(cv2.max(cv2.subtract(least, own), cv2.subtract(own, most)).max(axis=-1))
    ordered = np.sort(np.stack(steps), axis=0)
    count = (ordered < 255).sum(axis=0)
    half = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    return cv2.blur(np.where(count < FEWEST_LOOKERS, 0, half / np.float32(255)), near.shape)


def _with_alpha(colors: UInt8[np.ndarray, "rows columns 3"]) -> np.ndarray:
    return np.dstack([colors, np.full(colors.shape[:2], 255, np.uint8)])


def _homographies(
    photo: Looker, other: Looker, inverse_depths: Float[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, "D 3 3"], Bool[np.ndarray, " D"]]:
    """From places in a photo to those in another, of points in planes before the photo's camera,
    the middle of the first cell at 0, as OpenCV has it; and whether all that the photo shows of a
    plane lies before the other camera."""
    relative = other.viewmat @ np.linalg.inv(photo.viewmat)
    turns = np.repeat(relative[None, :3, :3], len(inverse_depths), axis=0)
    turns[:, :, 2] += inverse_depths[:, None] * relative[:3, 3]
    middle = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    there = np.linalg.inv(middle) @ other.K
    to_other = there @ turns @ np.linalg.inv(photo.K) @ middle
    rows, columns = photo.colors.shape[:2]
    corners = np.array([[0, 0, 1], [columns, 0, 1], [0, rows, 1], [columns, rows, 1]])
    return to_other, (to_other[:, 2] @ corners.T > 0).all(axis=1)


@dataclass(frozen=True)
class SeenPoints:
    """Where the photos of a capture show the points of its reconstruction, hidden ones too."""

    visible: Bool[np.ndarray, "V P"]
    depths: Float[np.ndarray, "V P"]
    toward: Float[np.ndarray, "V P 3"]
    """Directions from the cameras, of unit length."""
    places: Float[np.ndarray, "V P 2"]
    """As shares of the photo's width and height."""

    def common(self, photo: int, other: int) -> Bool[np.ndarray, " P"]:
        """Points that two photos show."""
        return self.visible[photo] & self.visible[other]


class Witnesses:
    """The photos of a capture, each asked about the others.

    Photos are kept in the warm-up, as its steps see them; what is unexplained in one is found when
    it is first asked for.
    """

    def __init__(self, points: Float[Tensor, "P 3"] | None, cameras: Cameras):
        """Args:
        points: of the reconstruction; without them nobody is a neighbour, and nothing is known.
        cameras: the training cameras, shape [V].
        """
        self._cameras = cameras
        self.photos: dict[int, UInt8[np.ndarray, "rows columns 3"]] = {}
        self._unexplained: dict[int, Float[Tensor, "rows columns"] | None] = {}
        self._points = None if points is None else sampled(points, MAX_POINTS).cpu()

    def keep(self, index: int, photo: Float[Tensor, "3 rows columns"]) -> None:
        """Keep what the photo of a view shows, colours in [0, 1]."""
        self.photos[index] = (photo * 255).round().byte().permute(1, 2, 0).cpu().numpy()

    def unexplained(self, index: int) -> Float[Tensor, "rows columns"] | None:
        """The larger of `unexplained` and `disputed` of a kept photo; None where nobody can be
        asked."""
        if index not in self._unexplained:
            found = self._sweep(index) if index in self.photos else None
            self._unexplained[index] = None if found is None else torch.from_numpy(found)
        return self._unexplained[index]

    def state(self) -> dict[int, Tensor]:
        """The kept photos, for a checkpoint."""
        return {index: torch.from_numpy(photo) for index, photo in self.photos.items()}

    def load(self, state: dict[int, Tensor]) -> None:
        """Take up what `state` gave."""
        self.photos = {index: photo.cpu().numpy() for index, photo in state.items()}
        self._unexplained.clear()

    def _sweep(self, index: int) -> Float[np.ndarray, "rows columns"] | None:
        others = sorted(self._others(index))
        if len(others) < 2:
            return None
        photo, seen = self._looker(index), self._seen
        nearest, farthest = np.quantile(seen.depths[index, seen.visible[index]], [0.01, 0.99])
        ends = 1 / (NEAREST * nearest), 1 / (FARTHEST * farthest)
        best = sorted(others, key=lambda other: -other[1])[:NEIGHBOURS]
        neighbours = [self._in_exposure_of(index, other) for *_, other in best]
        planes = np.append(np.linspace(*ends, PLANES), 0.0)
        found, at = unexplained(photo, neighbours, planes)
        near = [other for degrees, _, other in others if degrees < FARTHEST_ANGLE]
        if len(near) < FEWEST_LOOKERS:
            return found
        near = near[:: -(-len(near) // LOOKERS)]
        lookers = [self._in_exposure_of(index, other) for other in near]
        return np.maximum(found, disputed(photo, lookers, at))

    def _others(self, index: int) -> Iterator[tuple[float, float, int]]:
        """Photos that show points which one shows: degrees between the directions from which they
        see these, how much they have to say as a neighbour, and their numbers."""
        if self._points is None:
            return
        toward = self._seen.toward
        for other in self.photos:
            common = self._seen.common(index, other)
            if other == index or common.sum() < COMMON_POINTS:
                continue
            cosines = (toward[index, common] * toward[other, common]).sum(axis=-1)
            degrees = np.degrees(np.arccos(np.median(cosines).clip(-1, 1)))
            off = degrees - BEST_ANGLE
            yield degrees, common.sum() * np.exp(-((off / WIDTHS[int(off > 0)]) ** 2)), other

    def _looker(self, index: int) -> Looker:
        view, colors = self.views[index], self.photos[index]
        smaller = np.array([colors.shape[1] / view.width, colors.shape[0] / view.height, 1])
        K = smaller[:, None] * view.K.double().numpy()
        return Looker(colors, K, view.viewmat.double().numpy())

    def _in_exposure_of(self, index: int, other: int) -> Looker:
        """Another photo, with a gain for each channel that fits it to this one at the points that
        both show."""
        common = self._seen.common(index, other)
        places = self._seen.places[:, common]
        own, theirs = (_at(self.photos[i], places[i]) for i in (index, other))
        gain = np.exp(np.median(np.log(own / theirs), axis=0))
        looker = self._looker(other)
        colors = (looker.colors * gain).clip(0, 255).round().astype(np.uint8)
        return Looker(colors, looker.K, looker.viewmat)

    @cached_property
    def views(self) -> list[View]:
        """Of all photos, on the host."""
        return views_of(self._cameras.to("cpu"))

    @cached_property
    def _seen(self) -> SeenPoints:
        assert self._points is not None
        rows = []
        for view in self.views:
            u, v, depth = image_points(self._points, view)
            toward = torch.nn.functional.normalize(self._points - view.center, dim=-1)
            rows.append((in_image(u, v, depth), depth, toward, torch.stack([u, v], dim=-1)))
        return SeenPoints(*(torch.stack(part).cpu().numpy() for part in zip(*rows, strict=True)))


def _at(
    colors: UInt8[np.ndarray, "rows columns 3"], places: Float[np.ndarray, "P 2"]
) -> Float[np.ndarray, "P 3"]:
    rows, columns = colors.shape[:2]
    x, y = (places * [columns, rows]).astype(int).T
    return np.maximum(colors[y, x].astype(float), DARKEST)
