"""Small photos and what they show at the points of the reconstruction, read once for all evidence.

At each point lies a square of `GRID` x `GRID` samples that faces the cameras. Every photo into
which it projects shows it as a patch, whether the photo observed the point or not.
Letters in shapes: V photos, P points, S = GRID^2 samples, H x W pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.cores import cores
from desplat_ns.data.dataset import check_size
from desplat_ns.data.images import read_image, read_mask, resize_image, resize_mask
from desplat_ns.data.reconstruction import TRACKS, Tracks
from desplat_ns.survey.views import View, small_view

MOST_PHOTOS = 160
"""Larger captures are judged by so many photos, evenly spread over them."""

MOST_READERS = 8
"""Photos that are decoded at once at most: one of 12 megapixels takes 36 MB meanwhile."""

MOST_POINTS = 3000
"""Points at which colours are compared; more make no figure steadier."""

GRID = 5
"""Samples along a patch's side, about a pixel apart: the least that has a structure."""

PATCH_RADIUS = (GRID - 1) / 2
"""Pixels from the middle to the side of a patch in the photo that is the middle one in scale."""

SCALES = (0.4, 3.0)
"""A patch is not looked at where it is so many times smaller or larger: it shows other detail."""

DARKEST = 0.02
"""Values that are nearer to 0 or 1 are clipped: what the camera saw there is not known."""

HIDING_CELL = 1 / 50
"""Of the longest side: points in one cell of this size are compared in depth."""

HIDING_GAP = 0.93
"""A point is hidden where another one in its cell lies nearer than this fraction of its depth."""


@dataclass(frozen=True)
class Capture:
    """The training photos of a capture, as they are on disk: not undistorted."""

    cameras: Cameras
    photos: Sequence[Path]
    xyz: Float[np.ndarray, "_ 3"]
    """Points in the cameras' world."""
    tracks: Tracks | None = None
    """None where nobody knows which photo observed which point."""
    masks: Sequence[Path] | None = None
    """Where each photo may be used, if the capture says so."""


def capture_of(outputs: DataparserOutputs) -> Capture:
    """What a data parser says of the training split."""
    xyz = outputs.metadata.get("points3D_xyz")
    return Capture(
        cameras=outputs.cameras,
        photos=list(outputs.image_filenames),
        xyz=np.zeros((0, 3)) if xyz is None else xyz.double().cpu().numpy(),
        tracks=outputs.metadata.get(TRACKS),
        masks=outputs.mask_filenames,
    )


@dataclass
class Observations:
    """What the photos show at the points."""

    names: list[str]
    views: list[View]
    photos: list[np.ndarray]
    """Small copies: [H, W, 3], uint8."""
    allowed: list[np.ndarray]
    """Where a photo may be used: [H, W], bool."""
    xyz: Float[np.ndarray, "P 3"]
    """The chosen points."""
    places: Float[np.ndarray, "V P 2"]
    """Pixels at which the points appear, whether they are shown or not; NaN outside."""
    is_shown: Bool[np.ndarray, "V P"]
    """The patch lies inside the photo, in a fitting scale, and no nearer point is before it."""
    is_tracked: Bool[np.ndarray, "V P"]
    """The reconstruction found the point in this photo; without tracks, it is in view there."""
    colors: Float[np.ndarray, "V P 3"]
    """Mean of the patch in [0, 1]; 0 where it is not shown."""
    is_clipped: Bool[np.ndarray, "V P"]
    """A channel of the mean is too dark or too bright to be believed."""
    structures: Float[np.ndarray, "V P S"]
    """Brightness of the samples minus their mean, in the photo's own light."""
    has_tracks: bool
    num_photos: int
    """Of the split; more than were looked at if there are many."""
    all_xyz: Float[np.ndarray, "_ 3"]
    """All points, for what lies behind."""


def observe(capture: Capture) -> Observations:
    """Read the photos, as many at once as there are cores, and sample them at the points.

    Raises:
        CaptureError: a photo or mask that cannot be read, or does not fit its camera.
    """
    count = len(capture.photos)
    indices = np.unique(np.linspace(0, count - 1, min(count, MOST_PHOTOS)).round().astype(int))
    views = [small_view(capture.cameras, int(i)) for i in indices]
    with ThreadPoolExecutor(min(MOST_READERS, cores())) as pool:
        in_view, nearest = zip(
            *pool.map(lambda view: in_view_of(view, capture.xyz), views), strict=True
        )
        small = list(
            pool.map(lambda i, view: _read_small(capture, i, view), indices.tolist(), views)
        )
    tracked = _tracked(capture, indices, in_view)
    chosen = _chosen_points(tracked)
    xyz, tracked = capture.xyz[chosen], tracked[:, chosen]
    grids = patch_grids(xyz, tracked, views)
    shape = len(views), len(xyz)
    observations = Observations(
        names=[str(capture.photos[i].name) for i in indices],
        views=views,
        photos=[photo for photo, _ in small],
        allowed=[allowed for _, allowed in small],
        xyz=xyz,
        places=np.full((*shape, 2), np.nan, np.float32),
        is_shown=np.zeros(shape, bool),
        is_tracked=tracked,
        colors=np.zeros((*shape, 3), np.float32),
        is_clipped=np.zeros(shape, bool),
        structures=np.zeros((*shape, GRID * GRID), np.float32),
        has_tracks=capture.tracks is not None,
        num_photos=count,
        all_xyz=capture.xyz,
    )
    for row, view in enumerate(views):
        _sample(observations, row, grids, hidden_points(view, xyz, nearest[row]))
    observations.is_tracked &= observations.is_shown
    return observations


def _read_small(
    capture: Capture, index: int, view: View
) -> tuple[UInt8[np.ndarray, "H W 3"], Bool[np.ndarray, "H W"]]:
    """The photo at its view's size, and where it is opaque and not masked."""
    path, cameras = capture.photos[index], capture.cameras
    image = read_image(path)
    size = int(cameras.width.reshape(-1)[index]), int(cameras.height.reshape(-1)[index])
    check_size(path, (image.shape[1], image.shape[0]), size)
    image = resize_image(image, view.width, view.height)
    allowed = (image[..., 3:] == 255).all(axis=-1)
    if capture.masks is not None:
        allowed &= resize_mask(read_mask(capture.masks[index]), view.width, view.height)
    return image[..., :3], allowed


def _tracked(
    capture: Capture, indices: np.ndarray, in_view: Sequence[Bool[np.ndarray, " _"]]
) -> Bool[np.ndarray, "V _"]:
    """Which photo found which point; without tracks, which can have it in view."""
    if capture.tracks is None:
        tracked = np.stack(in_view)
    else:
        tracked = np.zeros((len(in_view), len(capture.xyz)), bool)
        for row, observed in zip(tracked, capture.tracks.read(indices.tolist()), strict=True):
            row[observed.points] = True
    return tracked & np.isfinite(capture.xyz).all(axis=1)


def _chosen_points(tracked: np.ndarray) -> np.ndarray:
    """Points that two photos found, those of the longest tracks if there are too many.

    Among tracks of three and more the choice is even, drawn with a fixed seed: long tracks alone
    would lie where all photos look.
    """
    views = tracked.sum(axis=0)
    chosen = np.flatnonzero(views >= 2)
    if len(chosen) > MOST_POINTS:
        draw = np.random.default_rng(0).random(len(views))
        order = np.lexsort((draw[chosen], -np.minimum(views[chosen], 3)))
        chosen = np.sort(chosen[order[:MOST_POINTS]])
    return chosen


def patch_grids(
    xyz: Float[np.ndarray, "P 3"], tracked: Bool[np.ndarray, "V P"], views: Sequence[View]
) -> Float[np.ndarray, "P S 3"]:
    """Samples of the points' squares in the world; the middle one is the point.

    A square faces the mean direction of the photos that found the point. Its size is such that it
    has `PATCH_RADIUS` in the middle one of them.
    """
    positions = np.array([view.position for view in views])
    focal = np.array([view.focal.mean() for view in views])
    toward = positions[:, None] - xyz[None]
    distance = np.linalg.norm(toward, axis=-1)
    weight = tracked / np.maximum(distance, 1e-12)
    normal = (toward * weight[..., None]).sum(axis=0)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    pixel = np.where(tracked, distance / focal[:, None], np.nan)
    radius = PATCH_RADIUS * np.nanmedian(pixel, axis=0) if len(xyz) else np.zeros(0)
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(helper, normal)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
    down = np.cross(normal, across)
    steps = np.linspace(-1, 1, GRID)
    a, b = (part.ravel()[None, :, None] for part in np.meshgrid(steps, steps))
    return xyz[:, None] + radius[:, None, None] * (a * across[:, None] + b * down[:, None])


def in_view_of(
    view: View, xyz: Float[np.ndarray, "N 3"]
) -> tuple[Bool[np.ndarray, " N"], Float[np.ndarray, "rows columns"]]:
    """Which points project into the photo, and the depth of the nearest in each cell and the eight
    around it."""
    cell = HIDING_CELL * max(view.width, view.height)
    shape = int(view.height / cell) + 3, int(view.width / cell) + 3
    nearest = np.full(shape, np.inf, np.float32)
    places, depths = view.project(xyz)
    inside = view.shows(places, depths)
    at = (places[inside] / cell).astype(int) + 1
    np.minimum.at(nearest, (at[:, 1], at[:, 0]), depths[inside].astype(np.float32))
    return inside, cv2.erode(nearest, np.ones((3, 3), np.uint8))


def hidden_points(
    view: View, xyz: Float[np.ndarray, "P 3"], nearest: Float[np.ndarray, "rows columns"]
) -> Bool[np.ndarray, " P"]:
    """Which points have another point before them, by what `in_view_of` found."""
    cell = HIDING_CELL * max(view.width, view.height)
    places, depths = view.project(xyz)
    inside = view.shows(places, depths)
    at = np.where(inside[:, None], places / cell, 0).astype(int) + 1
    return inside & (nearest[at[:, 1], at[:, 0]] < HIDING_GAP * depths)


def _sample(observations: Observations, row: int, grids: np.ndarray, hidden: np.ndarray) -> None:
    """Fill in what one photo shows."""
    view, photo, allowed = (
        observations.views[row],
        observations.photos[row],
        observations.allowed[row],
    )
    places, _ = view.project(observations.xyz)
    corners, corner_depths = view.project(grids)
    inside = view.shows(corners, corner_depths, 0.5).all(axis=-1)
    with np.errstate(invalid="ignore"):
        reach = np.linalg.norm(corners[:, -1] - corners[:, 0], axis=-1) / np.sqrt(8)
        shown = inside & (reach > SCALES[0] * PATCH_RADIUS) & (reach < SCALES[1] * PATCH_RADIUS)
    at = np.where(inside[:, None], places, 0).astype(int)
    shown &= allowed[at[:, 1].clip(0, view.height - 1), at[:, 0].clip(0, view.width - 1)] & ~hidden
    observations.places[row], observations.is_shown[row] = places, shown
    if not shown.any():
        return
    x, y = np.moveaxis((corners[shown] - 0.5).astype(np.float32), -1, 0)
    values, border = photo.astype(np.float32), cv2.BORDER_REPLICATE
    patches = cv2.remap(values, x, y, cv2.INTER_LINEAR, borderMode=border) / 255
    mean, grey = patches.mean(axis=1), patches.mean(axis=2)
    observations.colors[row, shown] = mean
    is_clipped = (mean < DARKEST) | (mean > 1 - DARKEST)
    observations.is_clipped[row, shown] = is_clipped.any(axis=1)
    observations.structures[row, shown] = grey - grey.mean(axis=1, keepdims=True)
