"""Small photos and what they show at the points of the reconstruction, read once for all evidence.

At each point lies a square of `GRID` x `GRID` samples that faces the cameras. Every photo into
which it projects shows it as a patch, whether the photo observed the point or not.
Letters in shapes: V photos, P points, S = GRID^2 samples, H x W pixels; N points, K pixels and M
places of one photo.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from nerfstudio.cameras.cameras import Cameras, CameraType
from nerfstudio.data.dataparsers.base_dataparser import DataparserOutputs

from desplat_ns.core.cores import cores
from desplat_ns.data.dataset import CaptureDataset
from desplat_ns.data.images import resize_image, resize_mask
from desplat_ns.data.reconstruction import TRACKS
from desplat_ns.data.training_views import even_subset

LONGEST_SIDE = 400
"""Pixels of the small copies."""
CELL = 1 / 48
"""Of the longest side. A place's neighbourhood are its cell and the eight around it."""
MOST_PHOTOS = 160
"""Larger captures are judged by so many photos, evenly spread over them."""
MOST_READERS = 8
"""Photos that are decoded at once at most: one of 12 megapixels takes 36 MB meanwhile."""
MOST_POINTS = 3000
"""Points at which colours are compared."""
COLOR_PHOTOS, COLOR_POINTS = 24, 100_000
"""So many photos, evenly spread, colour so many points in a few seconds; others are like these."""
GRID = 5
"""Samples along a patch's side, about a pixel apart: the least that has a structure."""
PATCH_RADIUS = (GRID - 1) / 2
"""Pixels from the middle to the side of a patch in the photo that is the middle one in scale."""
SCALES = (0.4, 3.0)
"""A patch is not looked at where it is so many times smaller or larger: it shows other detail."""
HIDING_CELL = 1 / 50
"""Of the longest side: points in one cell of this size are compared in depth."""
HIDING_GAP = 0.93
"""A point is hidden where another one in its cell lies nearer than this fraction of its depth."""


@dataclass(frozen=True)
class View:
    """The camera of a small copy: a pose, a lens, a size."""

    rotation: Float[np.ndarray, "3 3"]
    """World to camera; OpenCV axes (x right, y down, z forward)."""
    position: Float[np.ndarray, "3"]
    K: Float[np.ndarray, "3 3"]
    """Intrinsics in pixels."""
    size: tuple[int, int]
    """Width and height in pixels."""
    distortion: Float[np.ndarray, "6"]
    """k1, k2, k3, k4, p1, p2, as nerfstudio keeps them."""
    is_fisheye: bool

    def project(
        self, points: Float[np.ndarray, "*N 3"]
    ) -> tuple[Float[np.ndarray, "*N 2"], Float[np.ndarray, "*N"]]:
        """Pixels (the first one's centre is at 0.5) and depths; NaN pixels behind the camera."""
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            local = (points - self.position) @ self.rotation.T
            depth = local[..., 2]
            flat = local[..., :2] / np.where(depth > 0, depth, np.nan)[..., None]
            if flat.size == 0 or not (self.is_fisheye or self.distortion.any()):
                return flat * self.K.diagonal()[:2] + self.K[:2, 2], depth
        k1, k2, k3, k4, p1, p2 = self.distortion
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1).reshape(-1, 1, 3)
        if self.is_fisheye:
            bend, lens = cv2.fisheye.projectPoints, np.array([k1, k2, k3, k4])
        else:
            bend, lens = cv2.projectPoints, np.array([k1, k2, p1, p2, k3])
        places, _ = bend(rays, np.zeros(3), np.zeros(3), self.K, lens)
        return places.reshape(flat.shape), depth

    def shows(
        self, places: Float[np.ndarray, "*N 2"], depths: Float[np.ndarray, "*N"], margin: float = 0
    ) -> Bool[np.ndarray, "*N"]:
        """Which of projected points lie in the photo, so many pixels from its border at least."""
        with np.errstate(invalid="ignore"):
            inside = (places >= margin) & (places <= np.array(self.size) - margin)
            return inside.all(axis=-1) & (depths > 0)

    def directions(self, pixels: Float[np.ndarray, "*K 2"]) -> Float[np.ndarray, "*K 3"]:
        """Unit directions in the world, by a lens of this kind without distortion: a few pixels off
        at the corners, which does not matter for a sky."""
        flat = (pixels - self.K[:2, 2]) / self.K.diagonal()[:2]
        if self.is_fisheye:
            angle = np.linalg.norm(flat, axis=-1, keepdims=True)
            flat = flat * np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-9)
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1) @ self.rotation
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    @property
    def cell(self) -> float:
        """Pixels of a cell's side."""
        return max(1.0, CELL * max(self.size))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of cells that cover the photo."""
        width, height = self.size
        return int(np.ceil(height / self.cell)), int(np.ceil(width / self.cell))

    def cells_of(
        self, places: Float[np.ndarray, "M 2"]
    ) -> tuple[Int[np.ndarray, " M"], Int[np.ndarray, " M"]]:
        """Row and column of the cell in which each pixel place inside the photo lies."""
        at = (places / self.cell).astype(int)
        return at[:, 1].clip(0, self.grid[0] - 1), at[:, 0].clip(0, self.grid[1] - 1)

    def near_means(
        self, places: Float[np.ndarray, "M 2"], values: Float[np.ndarray, " M"]
    ) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
        """Mean of the other values near each place (0 where there is none), and their number."""
        at, sums = self.cells_of(places), np.zeros((*self.grid, 2))
        np.add.at(sums, at, np.stack([values, np.ones_like(values)], axis=-1))
        border = cv2.BORDER_CONSTANT
        near = cv2.boxFilter(sums, -1, (3, 3), normalize=False, borderType=border)[at]
        total, count = near[:, 0] - values, near[:, 1] - 1
        return np.where(count > 0, total / np.maximum(count, 1), 0.0), count


def small_view(cameras: Cameras, index: int) -> View:
    """The camera of one photo, reduced to `LONGEST_SIDE`; smaller photos keep their size."""
    camera = cameras[index].to("cpu")
    full = int(camera.width), int(camera.height)
    ratio = min(1.0, LONGEST_SIDE / max(full))
    size = max(1, round(full[0] * ratio)), max(1, round(full[1] * ratio))
    K = camera.get_intrinsics_matrices().double().numpy()
    pose = camera.camera_to_worlds.double().numpy()
    given = camera.distortion_params
    return View(
        rotation=(pose[:, :3] * [1, -1, -1]).T,  # nerfstudio's axes are OpenGL's
        position=pose[:, 3],
        K=K * [[size[0] / full[0]], [size[1] / full[1]], [1.0]],
        size=size,
        distortion=np.zeros(6) if given is None else given.double().numpy(),
        is_fisheye=int(camera.camera_type) == CameraType.FISHEYE.value,
    )


@dataclass
class Observations:
    """What the photos show at the points."""

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
    structures: Float[np.ndarray, "V P S"]
    """Brightness of the samples minus their mean, in the photo's own light."""
    has_tracks: bool
    all_xyz: Float[np.ndarray, "_ 3"]
    """All points, for what lies behind."""
    num_in_view: Int[np.ndarray, " V"]
    """How many of all points lie before each photo's camera and inside of the photo."""
    names: list[str]
    """Of the photos' files."""


def observe(capture: DataparserOutputs, most: int = MOST_PHOTOS) -> Observations:
    """Read at most so many of a split's photos, evenly spread, and sample them at its points.
    Raises CaptureError: a photo or mask that cannot be read, or does not fit its camera."""
    photos, tracks = capture.image_filenames, capture.metadata.get(TRACKS)
    given = capture.metadata.get("points3D_xyz")
    all_xyz = np.zeros((0, 3)) if given is None else given.double().cpu().numpy()
    indices, looks = _look_at(capture, most, all_xyz)
    views, small, allowed, in_view, _ = zip(*looks, strict=True)
    tracked = np.stack(in_view)
    if tracks is not None:
        tracked[:] = False
        for row, observed in zip(tracked, tracks.read(indices), strict=True):
            row[observed] = True
    tracked &= np.isfinite(all_xyz).all(axis=1)
    chosen = _chosen_points(tracked)
    xyz, tracked = all_xyz[chosen], tracked[:, chosen]
    grids = patch_grids(xyz, tracked, views)
    sampled = [
        _sample(view, photo, usable, xyz, grids, behind[chosen])
        for view, photo, usable, _, behind in looks
    ]
    places, shown, colors, structures = map(np.stack, zip(*sampled, strict=True))
    return Observations(
        views=[*views],
        photos=[*small],
        allowed=[*allowed],
        xyz=xyz,
        places=places,
        is_shown=shown,
        is_tracked=tracked & shown,
        colors=colors,
        structures=structures,
        has_tracks=tracks is not None,
        all_xyz=all_xyz,
        num_in_view=np.sum(in_view, axis=1),
        names=[Path(photos[index]).name for index in indices],
    )


_Look = tuple[View, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A view, the photo at its size, where that is opaque and not masked, and `in_view_of`."""


def _look_at(
    capture: DataparserOutputs, most: int, xyz: Float[np.ndarray, "N 3"]
) -> tuple[list[int], list[_Look]]:
    """Of at most so many photos, evenly spread, their numbers and what they show of points."""
    indices = even_subset(len(capture.image_filenames), most)
    dataset = CaptureDataset(capture)

    def look(index: int) -> _Look:
        view = small_view(capture.cameras, index)
        photo = dataset.get_data(index, "uint8")
        image = resize_image(photo["image"].numpy(), *view.size)
        allowed = (image[..., 3:] == 255).all(axis=-1)
        if "mask" in photo:
            allowed &= resize_mask(photo["mask"][..., 0].numpy(), *view.size)
        return view, image[..., :3], allowed, *in_view_of(view, xyz)

    with ThreadPoolExecutor(min(MOST_READERS, cores())) as pool:
        return indices, list(pool.map(look, indices))


def colors_of_photos(capture: DataparserOutputs) -> UInt8[np.ndarray, "N 3"]:
    """Colours of a split's points: the median of what the photos show there, else the colour of the
    nearest point that a photo shows; grey if none shows any. Raises as `observe`."""
    from sklearn.neighbors import NearestNeighbors

    all_xyz = capture.metadata["points3D_xyz"].double().cpu().numpy()
    xyz = all_xyz[:: -(-len(all_xyz) // COLOR_POINTS)]
    seen = np.full((COLOR_PHOTOS, *xyz.shape), np.nan, np.float32)
    looks = _look_at(capture, COLOR_PHOTOS, xyz)[1]
    for colors, (view, photo, allowed, inside, hidden) in zip(seen, looks, strict=False):
        at = np.where(inside[:, None], view.project(xyz)[0], 0).astype(int)
        column, row = np.minimum(at, np.array(view.size) - 1).T
        shown = inside & ~hidden & allowed[row, column]
        colors[shown] = photo[row, column][shown]
    known = np.isfinite(seen[..., 0]).any(axis=0)
    if not known.any():
        return np.full(all_xyz.shape, 128, np.uint8)
    colors = np.nanmedian(seen[:, known], axis=0).astype(np.uint8)
    nearest = NearestNeighbors(n_neighbors=1).fit(xyz[known])
    return colors[nearest.kneighbors(all_xyz, return_distance=False)[:, 0]]


def _chosen_points(tracked: np.ndarray) -> np.ndarray:
    """Points that two photos found; of too many, those that three and more found come first."""
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
    """Samples of the points' squares in the world; the middle one is the point. A square faces the
    mean direction of the photos that found the point, and has `PATCH_RADIUS` in the middle one."""
    positions = np.array([view.position for view in views])
    focal = np.array([view.K.diagonal()[:2].mean() for view in views])
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
) -> tuple[Bool[np.ndarray, " N"], Bool[np.ndarray, " N"]]:
    """Which points project into the photo, and which of these have another one before them, in
    their cell or in the eight around it."""
    cell = HIDING_CELL * max(view.size)
    nearest = np.full([int(side / cell) + 3 for side in view.size[::-1]], np.inf, np.float32)
    places, depths = view.project(xyz)
    inside = view.shows(places, depths)
    column, row = (np.where(inside[:, None], places / cell, 0).astype(int) + 1).T
    np.minimum.at(nearest, (row[inside], column[inside]), depths[inside].astype(np.float32))
    nearest = cv2.erode(nearest, np.ones((3, 3), np.uint8))
    return inside, inside & (nearest[row, column] < HIDING_GAP * depths)


def _sample(
    view: View,
    photo: UInt8[np.ndarray, "H W 3"],
    allowed: Bool[np.ndarray, "H W"],
    xyz: Float[np.ndarray, "P 3"],
    grids: Float[np.ndarray, "P S 3"],
    hidden: Bool[np.ndarray, " P"],
) -> tuple[np.ndarray, ...]:
    """What one photo shows: a row of `places`, `is_shown`, `colors`, `structures`."""
    places, _ = view.project(xyz)
    corners, corner_depths = view.project(grids)
    inside = view.shows(corners, corner_depths, 0.5).all(axis=-1)
    with np.errstate(invalid="ignore"):
        reach = np.linalg.norm(corners[:, -1] - corners[:, 0], axis=-1) / np.sqrt(8)
        shown = inside & (reach > SCALES[0] * PATCH_RADIUS) & (reach < SCALES[1] * PATCH_RADIUS)
    at = np.where(inside[:, None], places, 0).astype(int)
    shown &= allowed[at[:, 1], at[:, 0]] & ~hidden
    patches = np.zeros((len(xyz), GRID * GRID, 3), np.float32)
    if shown.any():
        x, y = np.moveaxis((corners[shown] - 0.5).astype(np.float32), -1, 0)
        values, border = photo.astype(np.float32), cv2.BORDER_REPLICATE
        patches[shown] = cv2.remap(values, x, y, cv2.INTER_LINEAR, borderMode=border) / 255
    colors, grey = patches.mean(axis=1), patches.mean(axis=2)
    structures = grey - grey.mean(axis=1, keepdims=True)
    return places.astype(np.float32), shown, colors, structures
