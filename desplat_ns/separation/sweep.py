"""What other photos say of a place, whatever the scene has learned so far: a plane sweep.

A place is scene if two neighbours show the same as this photo at some depth, unless most of the
photos that look at the place show something else there. If others look and no two of them agree
with this photo at any depth, something may be in the way. If hardly anybody else looks, nobody
knows. Letters in shapes: V views, P points.
"""

import threading
import time
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import count

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.cameras.near_plane import sampled
from desplat_ns.cameras.view_pairs import homographies, lower_median, views_beside
from desplat_ns.cameras.views import image_points, in_image, views_of
from desplat_ns.core.console import about, announce
from desplat_ns.core.devices import to_device
from desplat_ns.separation.grid import fine_grid_of, pooled

MAX_POINTS = 3000
"""Points of the reconstruction by which neighbours, depths and exposures are found."""

PLANES = 64
"""Depths that are tried, evenly spread in inverse depth, and one infinitely far away."""

NEAREST, FARTHEST = 0.5, 8.0
"""The depths reach from this share of the nearest point in view to this multiple of the farthest
one: the 1% and 99% quantiles count."""

NEIGHBOURS = 6
"""Other photos that are asked about one."""

FARTHEST_ANGLE, LOOKERS, FEWEST_LOOKERS = 60.0, 40, 8
"""Photos up to `FARTHEST_ANGLE` degrees apart may dispute what two neighbours confirm. At most
`LOOKERS` of them are asked, and `FEWEST_LOOKERS` have to look at a place: a few may all be wrong.
"""

RADIUS = 1
"""Photos are compared over windows of 2 `RADIUS` + 1 cells."""

SURROUNDINGS = 5
"""Cells (an odd number) across, anywhere in which a photo may show a place without disputing it,
because the depth is not exact. Disputes are averaged over as many."""

LOOKED_AT = 0.95
"""Share of the planes from the nearest point on at which two neighbours have to look at a cell: at
the border of a walk they look at others than the place that it shows."""

BESIDE = 0.3
"""Of a photo's width: below the lowest point of the reconstruction within as much to either side
nobody knows, since the ground comes nearer than any depth that is tried."""

DARKEST = 8
"""Of 255: darker colours say nothing of the exposure."""

MOST = 254
"""Of 255, how much colours differ at the most: 255 is left for what a photo does not show."""

QUIET = 5.0
"""Seconds of sweeping, in all, after which a line says how long it takes."""

CPU = torch.device("cpu")


@dataclass(frozen=True)
class PosedPhoto:
    """A photo in cells, and its camera."""

    colors: UInt8[np.ndarray, "rows columns C"]
    """Three colours; where a mask leaves something out, also alpha: 0 in cells that are not shown,
    255 in others."""
    K: Float[np.ndarray, "3 3"]
    """Intrinsics, in cells."""
    viewmat: Float[np.ndarray, "4 4"]
    """World to camera, OpenCV axes."""


def unexplained(
    photo: PosedPhoto, others: Sequence[PosedPhoto], inverse_depths: Float[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """By how much each cell of a photo differs from what two others show, at the depth where they
    come nearest to it, colours in [0, 1]; and that depth, inverse.

    The difference is NaN where fewer than two others look at `LOOKED_AT` of the depths, those
    before the nearest point (`NEAREST`) not counted, and where the photo itself does not show all
    of the window. The second-best other counts: the best one may show the same thing in the way.

    Args:
        others: in the exposure of the photo.
        inverse_depths: of planes before the photo's camera, per world unit.

    Source: plane sweep of Collins 1996, with the mean absolute difference of colours.
    """
    rows, columns = photo.colors.shape[:2]
    least, looked = np.full((rows, columns), 255, np.uint8), np.zeros((rows, columns), int)
    at, counts = np.zeros((rows, columns)), inverse_depths <= NEAREST * inverse_depths.max()
    opaque = np.dstack([photo.colors[..., :3], np.full_like(least, 255)])
    pictures = [np.dstack([other.colors[..., :3], _shown(other.colors)]) for other in others]
    posed, size = (photo.K, photo.viewmat), (columns, rows)
    warps = [homographies(*posed, o.K, o.viewmat, size, inverse_depths) for o in others]
    for plane in range(len(inverse_depths)):
        best, second = np.full((2, rows, columns), 255, np.uint8)
        for (to_other, is_before), picture in zip(warps, pictures, strict=True):
            if not is_before[plane]:
                continue
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            warped = cv2.warpPerspective(picture, to_other[plane], (columns, rows), flags=flags)
            # where the other photo shows nothing alpha is 0, so the difference is 255
            red, green, blue, alpha = cv2.split(cv2.absdiff(warped, opaque))
            step = cv2.max(np.minimum(cv2.max(cv2.max(red, green), blue), MOST), alpha)
            step = cv2.blur(step, (2 * RADIUS + 1,) * 2)
            second = cv2.min(second, cv2.max(best, step))
            best = cv2.min(best, step)
        looked += counts[plane] & (second < 255)
        at[second < least] = inverse_depths[plane]
        least = cv2.min(least, second)
    is_known = looked >= LOOKED_AT * counts.sum()
    is_known &= _shown(photo.colors, 2 * RADIUS + 1) > 0
    return np.where(is_known, least / np.float32(255), np.float32(np.nan)), at


def below_points(
    u: Float[np.ndarray, " P"], v: Float[np.ndarray, " P"], rows: int, columns: int
) -> Bool[np.ndarray, "rows columns"]:
    """Cells of a photo that lie below all points, at u and v in [0, 1), within `BESIDE`, if there
    are any."""
    lowest, reach = np.full((1, columns), -1, np.float32), 2 * round(BESIDE * columns) + 1
    np.maximum.at(lowest[0], (u * columns).astype(int), (v * rows).astype(np.float32))
    lowest = cv2.dilate(lowest, np.ones((1, reach), np.uint8))
    return (np.arange(rows)[:, None] > lowest) & (lowest >= 0)


def disputed(
    photo: PosedPhoto,
    others: Sequence[PosedPhoto],
    inverse_depths: Float[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "rows columns"]:
    """By how much each cell of a photo at least differs from what half of the others that look at
    its place show there, colours in [0, 1]; 0 where fewer than `FEWEST_LOOKERS` look, and where the
    photo itself does not show all of the window.

    Args:
        others: in the exposure of the photo.
        inverse_depths: of the cells before the photo's camera, per world unit.
    """
    y, x = np.indices(inverse_depths.shape) + 0.5
    rays = np.tensordot(np.linalg.inv(photo.K), np.stack([x, y, np.ones_like(x)]), 1)
    places = np.concatenate([rays, inverse_depths[None]])
    window, near = (2 * RADIUS + 1,) * 2, np.ones((SURROUNDINGS,) * 2, np.uint8)
    opaque = np.full(photo.colors.shape[:2], 255, np.uint8)
    own, steps = np.dstack([cv2.blur(photo.colors[..., :3], window), opaque]), []
    for other in others:
        to_other = other.K @ other.viewmat[:3] @ np.linalg.inv(photo.viewmat)
        *there, depth = np.tensordot(to_other, places, 1)
        ahead = np.maximum(depth, np.finfo(np.float32).tiny)
        at = [np.where(depth > 0, (uv / ahead - 0.5).clip(-9, 1e4), -9) for uv in there]
        u, v = np.stack(at).astype(np.float32)
        smooth = cv2.blur(other.colors[..., :3], window)
        alpha = _shown(other.colors, 2 * RADIUS + SURROUNDINGS)
        least, most = (
            cv2.remap(np.dstack([end(smooth, near), alpha]), u, v, cv2.INTER_NEAREST)
            for end in (cv2.erode, cv2.dilate)
        )  # where the other photo shows nothing alpha is 0, so the difference is 255
        step = cv2.max(cv2.subtract(least, own), cv2.subtract(own, most))
        steps.append(np.maximum(np.minimum(step[..., :3].max(axis=-1), MOST), step[..., 3]))
    half, lookers = lower_median(np.stack(steps), 255.0)
    is_disputed = (lookers >= FEWEST_LOOKERS) & (_shown(photo.colors, 2 * RADIUS + 1) > 0)
    return cv2.blur(np.where(is_disputed, half / np.float32(255), 0), near.shape)


def _shown(
    colors: UInt8[np.ndarray, "rows columns C"], window: int = 1
) -> UInt8[np.ndarray, "rows columns"]:
    """255 where the photo shows all cells of a window as far as it reaches, else 0."""
    alpha = colors[..., 3] if colors.shape[2] > 3 else np.full(colors.shape[:2], 255, np.uint8)
    return cv2.erode(alpha, np.ones((window, window), np.uint8))


@torch.no_grad()
def photo_to_sweep(
    photo: Float[Tensor, "H W 3"], mask: Bool[Tensor, "H W 1"] | None
) -> UInt8[Tensor, "rows columns C"]:
    """A photo in [0, 1] as `PosedPhoto` has it, in cells of `fine_grid_of`. Cells are shown if all
    their pixels count by the user's mask, which is True there."""
    height, width = photo.shape[:2]
    layers = [photo] if mask is None else [photo, mask.to(photo.dtype)]
    cells = pooled(torch.cat(layers, dim=-1), fine_grid_of(width, height))
    cells[3:] = (cells[3:] > 0.999).to(cells.dtype)
    return (cells * 255).round().byte().permute(1, 2, 0)


class PlaneSweep:
    """What each photo of a capture shows that others do not, by photos and cameras alone.

    Photos are kept at their first visit. Each is swept once: when it is first asked for, or on a
    GPU by a thread that starts when all photos are there, for which no step waits (`is_ready`).
    """

    def __init__(self, points: Float[Tensor, "P 3"] | None, cameras: Cameras):
        """Args:
        points: of the reconstruction; without them nobody is a neighbour, and nothing is known.
        cameras: the training cameras, shape [V].
        """
        self._cameras = cameras
        self.photos: dict[int, UInt8[np.ndarray, "rows columns C"]] = {}
        self._unexplained: dict[int, Float[Tensor, "rows columns"] | None] = {}
        self._locks = [threading.Lock() for _ in range(len(cameras))]
        """Of each photo: whoever has it sweeps."""
        self._worker: threading.Thread | None = None
        self._tried = set[int]()
        """Photos that the thread has swept, or met an error in."""
        self._seconds = 0.0
        points = torch.empty(0, 3) if points is None else points
        self._points = sampled(points, MAX_POINTS).cpu()

    def keep(self, index: int, photo: UInt8[Tensor, "rows columns C"]) -> None:
        """Keep what the photo of a view shows, by `photo_to_sweep`."""
        self.photos[index] = photo.cpu().numpy()
        self._unexplained.clear()  # of fewer photos
        self._work_ahead(photo.device)

    def is_ready(self, index: int, device: torch.device) -> bool:
        """Whether a step that asks is answered without waiting for the thread: always if there is
        none, on a CPU and before all photos are there."""
        self._work_ahead(device)
        return self._worker is None or index in self._tried or index not in self.photos

    def unexplained(
        self, index: int, device: torch.device = CPU
    ) -> Float[Tensor, "rows columns"] | None:
        """The larger of `unexplained` and `disputed` of a kept photo, on the device; NaN also in
        `below_points`; None where nobody can be asked. Waits for a thread that is at it."""
        if index not in self.photos:
            return None
        self._work_ahead(device)
        with self._locks[index]:
            if index not in self._unexplained:
                before, started = self._seconds, time.monotonic()
                found = self._sweep(index)
                self._unexplained[index] = None if found is None else to_device(found, device)
                self._seconds += time.monotonic() - started
                if before <= QUIET < self._seconds:
                    photos, each = len(self.photos), self._seconds / len(self._unexplained)
                    announce(f"Plane sweep of {photos} photos: {about(photos * each)}, once a run.")
            return self._unexplained[index]

    def state(self) -> dict[int, Tensor]:
        """The kept photos, for a checkpoint."""
        return {index: torch.from_numpy(photo) for index, photo in self.photos.items()}

    def load(self, state: dict[int, Tensor]) -> None:
        """Take up what `state` gave."""
        self.photos = {index: photo.cpu().numpy() for index, photo in state.items()}
        self._unexplained.clear()
        self._tried, self._worker = set(), None

    def _work_ahead(self, device: torch.device) -> None:
        """Start the thread, if all photos are there; on a CPU it would take the steps' cores."""
        is_complete = len(self.photos) == len(self._cameras)
        if device.type != "cpu" and is_complete and self._worker is None:
            self._worker = threading.Thread(target=_sweep_all, args=(weakref.ref(self), device))
            self._worker.start()

    def _sweep(self, index: int) -> Float[np.ndarray, "rows columns"] | None:
        kept = np.array(sorted(self.photos))
        centers = self._cameras.camera_to_worlds[..., 3].cpu().numpy()
        xyz = self._points.numpy()
        degrees, weights, others = views_beside(index, kept, self._visible, xyz, centers)
        if len(others) < 2:
            return None
        photo = self._posed(index)
        at_points = image_points(self._points, self.views[index])
        u, v, depths = (part.numpy()[self._visible[index]] for part in at_points)
        nearest, farthest = np.quantile(depths, [0.01, 0.99])
        ends = 1 / (NEAREST * nearest), 1 / (FARTHEST * farthest)
        best = others[np.argsort(-weights, kind="stable")[:NEIGHBOURS]]
        neighbours = [self._in_exposure_of(index, other) for other in best.tolist()]
        planes = np.append(np.linspace(*ends, PLANES), 0.0)
        found, at = unexplained(photo, neighbours, planes)
        found[below_points(u, v, *found.shape)] = np.nan
        near = others[degrees < FARTHEST_ANGLE]
        if len(near) < FEWEST_LOOKERS:
            return found
        near = near[:: -(-len(near) // LOOKERS)].tolist()
        lookers = [self._in_exposure_of(index, other) for other in near]
        return np.maximum(found, disputed(photo, lookers, at))

    def _posed(self, index: int, gain: float | np.ndarray = 1.0) -> PosedPhoto:
        """A photo with its camera, its colours times a gain."""
        view, colors = self.views[index], self.photos[index].copy()
        colors[..., :3] = (colors[..., :3] * gain).clip(0, 255).round()
        smaller = np.array([colors.shape[1] / view.width, colors.shape[0] / view.height, 1])
        K = smaller[:, None] * view.K.double().numpy()
        return PosedPhoto(colors, K, view.viewmat.double().numpy())

    def _in_exposure_of(self, index: int, other: int) -> PosedPhoto:
        """Another photo, with a gain for each channel that fits it to this one at the points that
        both show."""
        common = self._visible[index] & self._visible[other]
        (own, is_own), (theirs, is_theirs) = (self._at(i, common) for i in (index, other))
        logs = np.log(own / theirs)[is_own & is_theirs]
        return self._posed(other, np.exp(np.median(logs, axis=0)) if len(logs) else 1.0)

    def _at(
        self, index: int, common: Bool[np.ndarray, " P"]
    ) -> tuple[Float[np.ndarray, "Q 3"], Bool[np.ndarray, " Q"]]:
        """What a photo shows of some of its points, and of which it shows anything."""
        colors = self.photos[index]
        u, v, _ = (part.numpy()[common] for part in image_points(self._points, self.views[index]))
        y, x = (v * colors.shape[0]).astype(int), (u * colors.shape[1]).astype(int)
        return np.maximum(colors[y, x, :3].astype(float), DARKEST), _shown(colors)[y, x] > 0

    @cached_property
    def views(self) -> list[View]:
        """Of all photos, on the host."""
        return views_of(self._cameras.to("cpu"))

    @cached_property
    def _visible(self) -> Bool[np.ndarray, "V P"]:
        """Points that the photos show, hidden ones too."""
        return np.stack([in_image(*image_points(self._points, v)).numpy() for v in self.views])


def _sweep_all(of: weakref.ref[PlaneSweep], device: torch.device) -> None:
    """Sweep photo by photo while somebody is there to ask. An error comes again, and is seen, in
    the step that asks for the photo.

    No daemon: Python kills those at its end, and in OpenCV that aborts the process.
    """
    for index in count():
        sweep = of()
        if sweep is None or index not in sweep.photos or not threading.main_thread().is_alive():
            return
        with suppress(Exception):
            sweep.unexplained(index, device)
        sweep._tried.add(index)
        del sweep
