"""What two views have to do with each other: who looks at the same points, and from how far apart;
where a plane before one is seen by the other. Letters in shapes: V views, P points."""

import numpy as np
from jaxtyping import Bool, Float, Int, Num

BEST_ANGLE, WIDTHS = 8.0, (5.0, 12.0)
"""Degrees between the directions from which two photos see their common points. Nearer neighbours
show something in the way before the same background, farther ones another side of the scene;
weights fall like Gaussians of these widths, below and above."""

COMMON_POINTS = 10
"""Views with fewer common points have nothing to say of each other."""

MOST_ANGLES = 2**18
"""Angles that are computed for one view: with more than some hundred views, those at some of its
points, so that each view takes as long whatever their number."""


def views_beside(
    index: int,
    candidates: Int[np.ndarray, " C"],
    visible: Bool[np.ndarray, "V P"],
    points: Float[np.ndarray, "P 3"],
    centers: Float[np.ndarray, "V 3"],
) -> tuple[Float[np.ndarray, " O"], Float[np.ndarray, " O"], Int[np.ndarray, " O"]]:
    """The candidates that see points which view `index` sees, the nearest direction first: median
    degrees between the directions from which both see these, how much each has to say as a
    neighbour, and its number.

    Args:
        visible: points that each view has in its image.
        centers: of the cameras, in the points' frame.
    """
    seen = visible[index]
    common = (visible[candidates] & seen).sum(axis=1)
    is_other = (common >= COMMON_POINTS) & (candidates != index)
    common, others = common[is_other], candidates[is_other]
    chosen = np.flatnonzero(seen)
    chosen = chosen[:: max(1, -(-len(chosen) * len(others) // MOST_ANGLES))]
    rays = points[chosen, None] - centers[np.append(others, index)]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    angles = np.degrees(np.arccos((rays[:, :-1] * rays[:, -1:]).sum(axis=-1).clip(-1, 1)))
    is_common = visible[others][:, chosen].T
    degrees, _ = lower_median(np.where(is_common, angles, 180.0), 180.0)
    off = degrees - BEST_ANGLE
    weights = common * np.exp(-((off / np.where(off > 0, WIDTHS[1], WIDTHS[0])) ** 2))
    order = np.argsort(degrees, kind="stable")
    return degrees[order], weights[order], others[order]


def homographies(
    K: Float[np.ndarray, "3 3"],
    viewmat: Float[np.ndarray, "4 4"],
    other_K: Float[np.ndarray, "3 3"],
    other_viewmat: Float[np.ndarray, "4 4"],
    size: tuple[int, int],
    inverse_depths: Float[np.ndarray, " D"],
) -> tuple[Float[np.ndarray, "D 3 3"], Bool[np.ndarray, " D"]]:
    """From places in one view to those in another, of points in planes before the first, the middle
    of the first pixel at 0, as OpenCV has it; and whether all that the first shows of a plane lies
    before the other camera.

    Args:
        K: intrinsics, in pixels of the pictures that are warped.
        viewmat: world to camera, OpenCV axes.
        size: columns and rows of the first view.
        inverse_depths: of the planes, per world unit.
    """
    relative = other_viewmat @ np.linalg.inv(viewmat)
    turns = np.repeat(relative[None, :3, :3], len(inverse_depths), axis=0)
    turns[:, :, 2] += inverse_depths[:, None] * relative[:3, 3]
    middle = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    to_other = np.linalg.inv(middle) @ other_K @ turns @ np.linalg.inv(K) @ middle
    columns, rows = size
    corners = np.array([[0, 0, 1], [columns, 0, 1], [0, rows, 1], [columns, rows, 1]])
    return to_other, (to_other[:, 2] @ corners.T > 0).all(axis=1)


def lower_median(values: Num[np.ndarray, "N ..."], absent: float) -> tuple[np.ndarray, np.ndarray]:
    """The lower median along the first axis of the values below `absent`, and their number."""
    present = (values < absent).sum(axis=0)
    place = np.maximum(present - 1, 0)[None] // 2
    return np.take_along_axis(np.sort(values, axis=0), place, axis=0)[0], present
