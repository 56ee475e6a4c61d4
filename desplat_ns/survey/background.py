"""Whether there is a sky, and whether its colour depends on direction and on the photo.

A sky are the cells of a photo that have nothing behind them, as far as that can be told: no point
of the whole reconstruction lies in such a cell's direction or near it, it is smooth, it lies
clearly above the horizon, and nothing lies above it. A bare wall or ceiling that high above
everything else looks the same.
Letters in shapes: V photos, R x C cells of one photo, K sky cells of all photos.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.survey.findings import Finding, confidence_of
from desplat_ns.survey.observations import Observations, View
from desplat_ns.survey.photo_light import FEWEST, LOWEST, PhotoLight, from_middle

AROUND = 5
"""Cells across the disc around a point in which something counts as behind: a tenth of the side."""
SMOOTH = 0.04
"""Mean change of the values from pixel to pixel, across plus down, below which a cell is smooth:
clouds are, leaves against the sky are not."""
UPRIGHT = 0.05
"""Weight of the cameras' own up against their horizontals, which tell the vertical better."""
LEAST_RISE = float(np.sin(np.radians(6.0)))
"""Of a direction above the horizon: up to there photos that look down show the walls of a room."""
STEEP = 0.3
"""Length of the vertical in the image plane below which a photo looks up or down too steeply."""
VISIBLE_SHARE = 0.04
"""Of the photos' area, in the mean. Gaussians at the edge of the scene can take less."""
RANGE = 0.022
"""Of the range of values, between directions: six of 255 levels, which one sees on a smooth sky."""
BY_PHOTO = 0.06
"""Of the range of values, as `spread_by_photo`. Photos also have to differ by more than directions
do: until then a sky that all share explains most."""
CHROMA_BY_PHOTO = 0.055
"""The same in log of a channel over the mean of the channels, where light changes place by place
and so the brightness of a photo's sky is not known."""
TURN, RISE = 8.0, 3.0
"""Degrees of azimuth and elevation that count as the same direction."""
FEWEST_PHOTOS, FEWEST_CELLS = 3, 4
"""Photos that show a direction, without which they are not compared in it, and cells of one."""
FEWEST_POINTS = 100
"""Of a reconstruction, without which one cannot tell where there is nothing."""


@dataclass(frozen=True)
class Sky:
    """The sky of one photo, if any."""

    cells: Bool[np.ndarray, "R C"]
    values: Float[np.ndarray, "R C 3"]
    """Mean of each cell's values in [0, 1]."""
    directions: Float[np.ndarray, "R C 3"]
    """In the world, unit."""


def vertical(views: list[View]) -> Float[np.ndarray, "3"]:
    """The world's up, from how the cameras were held: their x axes are horizontal."""
    right = np.array([view.rotation[0] for view in views])
    up = -np.mean([view.rotation[1] for view in views], axis=0)
    left = right.T @ right / len(right) + UPRIGHT * np.eye(3)
    direction = np.linalg.solve(left, UPRIGHT * up)
    return direction / max(float(np.linalg.norm(direction)), 1e-12)


def skies_of(observations: Observations) -> dict[int, Sky]:
    """The sky of every photo that shows anything of the scene."""
    up = vertical(observations.views)
    known = np.flatnonzero(observations.is_shown.sum(axis=1) >= FEWEST)
    return {int(row): _find_sky(observations, int(row), up) for row in known}


def _find_sky(observations: Observations, row: int, up: Float[np.ndarray, "3"]) -> Sky:
    view, photo = observations.views[row], observations.photos[row]
    rows, columns = view.grid

    def by_cells(values: np.ndarray) -> np.ndarray:
        return cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA)

    places, depths = view.project(observations.all_xyz)
    hit = np.zeros(view.grid, np.uint8)
    hit[view.cells_of(places[view.shows(places, depths)])] = 1
    behind = cv2.dilate(hit, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (AROUND, AROUND))) > 0
    grey: np.ndarray = photo.astype(np.float32).mean(axis=2) / 255
    across = np.abs(np.diff(grey, axis=1, prepend=grey[:, :1]))
    down = np.abs(np.diff(grey, axis=0, prepend=grey[:1]))
    centers = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    directions = view.directions(centers * view.cell)
    cells = ~behind & (by_cells(across + down) < SMOOTH) & (directions @ up > LEAST_RISE)
    cells &= _nothing_above(behind, view.rotation @ up)
    cells &= by_cells(observations.allowed[row].astype(np.float32)) > 0.99
    return Sky(cells, by_cells(photo) / 255.0, directions)


def _nothing_above(behind: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Cells from which the way up (`up` in camera axes) to the border meets nothing."""
    length = float(np.hypot(up[0], up[1]))
    is_open = np.full_like(behind, length >= STEEP)
    rows, columns = np.indices(behind.shape)
    for count in range(1, sum(behind.shape) if length >= STEEP else 0):
        x = np.rint(columns + count * (up[0] / length)).astype(int)
        y = np.rint(rows + count * (up[1] / length)).astype(int)
        inside = (x >= 0) & (x < behind.shape[1]) & (y >= 0) & (y < behind.shape[0])
        is_open[inside] &= ~behind[y[inside], x[inside]]
    return is_open


def sky_colors(
    observations: Observations, light: PhotoLight, skies: dict[int, Sky]
) -> tuple[Float[np.ndarray, "K 3"], Int[np.ndarray, " K"], Int[np.ndarray, " K"]]:
    """Colours, in the light common to all photos, of cells around which all is sky; the number of
    each one's photo among those with sky, and of its bin of directions."""
    up = vertical(observations.views)
    north = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    north /= np.linalg.norm(north)
    east = np.cross(north, up)
    colors, photo, bins = [np.zeros((0, 3))], [], []
    for row, sky in skies.items():
        padded = cv2.copyMakeBorder(sky.cells.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        at = np.nonzero(cv2.erode(padded, np.ones((3, 3), np.uint8))[1:-1, 1:-1])
        if len(at[0]) < FEWEST_CELLS:
            continue
        height, width = sky.cells.shape
        rho2 = from_middle((width, height), np.stack([at[1] + 0.5, at[0] + 0.5], axis=-1))
        colors.append(light.neutral(row, sky.values[at], rho2))
        toward = sky.directions[at]
        azimuth = np.degrees(np.arctan2(toward @ north, toward @ east))
        elevation = np.degrees(np.arcsin(np.clip(toward @ up, -1, 1)))
        bins += (1000 * np.round(azimuth / TURN) + np.round(elevation / RISE)).tolist()
        photo += [row] * len(toward)
    numbers = [np.unique(np.array(kind, int), return_inverse=True)[1] for kind in (photo, bins)]
    return np.concatenate(colors), numbers[0], numbers[1]


def range_by_direction(
    values: Float[np.ndarray, "K 3"], photo: Int[np.ndarray, " K"], direction: Int[np.ndarray, " K"]
) -> float:
    """How far directions differ within photos, whose own medians are taken out: 10% to 90% of the
    area, the widest channel; NaN where there is no sky."""
    if len(values) == 0:
        return float("nan")
    middles = _medians(values - _medians(values, photo), direction)
    low, high = np.quantile(middles, [0.1, 0.9], axis=0)
    return float((high - low).max())


def spread_by_photo(
    values: Float[np.ndarray, "K 3"], photo: Int[np.ndarray, " K"], direction: Int[np.ndarray, " K"]
) -> float:
    """RMS of a photo's median difference from what all photos show in the same directions: what a
    quarter of the photos exceed; NaN where fewer than `FEWEST_PHOTOS` look in any direction."""
    if len(values) == 0:
        return float("nan")
    pairs = np.unique(np.stack([direction, photo]), axis=1)
    shared = np.bincount(pairs[0])[direction] >= FEWEST_PHOTOS
    differences = values - _medians(values, direction)
    own = [
        np.median(differences[mine], axis=0)
        for row in range(photo.max() + 1)
        if (mine := (photo == row) & shared).sum() >= FEWEST_CELLS
    ]
    return float(np.quantile(np.sqrt(np.mean(np.square(own), axis=1)), 0.75)) if own else np.nan


def _medians(values: np.ndarray, number: np.ndarray) -> np.ndarray:
    """For each row the median of the rows with its number."""
    groups = range(number.max() + 1)
    return np.array([np.median(values[number == group], axis=0) for group in groups])[number]


def background_finding(
    observations: Observations, light: PhotoLight, skies: dict[int, Sky], light_is_local: bool
) -> Finding:
    """Decide what lies behind the scene; where light changes place by place, by
    `CHROMA_BY_PHOTO`.

    Figures: `empty`, the mean share of the photos' area that is sky; `by_photo`, as of
    `spread_by_photo`; `by_direction`, as of `range_by_direction`.
    """
    shares = [sky.cells.mean() for sky in skies.values()]
    empty = float(np.mean(shares)) if shares else np.nan
    figures = {"empty": empty}
    if len(observations.all_xyz) < FEWEST_POINTS:
        reason = f"Fewer than {FEWEST_POINTS} points say where the scene is."
        return Finding("background", "off", "none", reason, figures)
    if not shares:
        reason = f"No photo shows {FEWEST} of the points."
        return Finding("background", "off", "none", reason, figures)
    colors, *cells = sky_colors(observations, light, skies)
    logs = np.log(np.maximum(colors, LOWEST))
    chroma = logs - logs.mean(axis=1, keepdims=True)
    values, limit = (chroma, CHROMA_BY_PHOTO) if light_is_local else (colors, BY_PHOTO)
    limit = np.fmax(limit, range_by_direction(values, *cells)).item()
    by_photo, by_direction = spread_by_photo(values, *cells), range_by_direction(colors, *cells)
    figures |= {"by_photo": by_photo, "by_direction": by_direction}
    sky = f"{empty:.0%} of the photos' area is sky"
    judged = [(empty, VISIBLE_SHARE), (by_photo, limit)]
    if not empty > VISIBLE_SHARE:
        decision, judged = "off", judged[:1]
        reason = (
            f"The scene fills the photos: {empty:.1%} of their area may be sky "
            f"(above {VISIBLE_SHARE:.0%} it counts)."
        )
    elif by_photo > limit:
        decision = "image"
        reason = (
            f"{sky}, and photos show different ones: they differ by {by_photo:.3f} "
            f"(above {limit:.3f} it counts)."
        )
    elif np.isnan(by_photo):
        reason = f"{sky}; photos do not look in the same directions."
        return Finding("background", "sh", "close", reason, figures)
    else:
        judged.append((by_direction, RANGE))
        decision = "sh" if by_direction > RANGE else "constant"
        reason = (
            f"{sky}, one for all photos, and its directions differ by {by_direction:.3f} of "
            f"the range of values (above {RANGE:.3f} it counts)."
        )
    return Finding("background", decision, confidence_of(*judged), reason, figures)
