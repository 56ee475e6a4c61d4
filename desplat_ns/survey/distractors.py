"""Whether things stand before the scene in some photos only.

Nothing is observed under a distractor, so what counts are the points that a photo should show:
at least two photos from nearly the same direction and distance found them. The photo disagrees
about such a point if neither colour nor structure are those of any of these neighbours.
A distractor is where a photo disagrees about nearly all points near one another; glints, edges
and inaccurate points are scattered.
Letters in shapes: V photos, P points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from desplat_ns.console import list_names
from desplat_ns.survey.findings import Figure, Finding, confidence_of
from desplat_ns.survey.matching import FEWEST_NEIGHBOURS, are_alike, directions, neighbours
from desplat_ns.survey.neighbourhood import cells_of, near_means
from desplat_ns.survey.observations import Observations
from desplat_ns.survey.photo_light import PhotoLight, from_middle

COLOR_STEP = 0.12
"""Of the range of values, in the light common to all photos: twice what light leaves in photos of
tourists, and less than between most things."""

FEWEST_NEAR, VOTE = 4, 0.7
"""A photo's disagreement counts where at least so many other expected points are near and this
share of them disagrees, too."""

CLIPPED_PHOTO = 0.9
"""A photo of which this share of the patches is black or white says nothing of the scene."""

COVERED_SHARE = 0.003
"""Of the expected points. Where nothing stands in the way, up to 0.0005 were seen to be covered."""

JUDGED_SHARE = 1 / 3
"""Of the photos' area: if less of it has expected points, distractors may be where there are none.
Photos on which thresholds were set have twice as much or more."""

EFFECT = "distractors"


@dataclass(frozen=True)
class Disagreement:
    """Where photos do not show what they should."""

    is_expected: Bool[np.ndarray, "V P"]
    disagrees: Bool[np.ndarray, "V P"]
    """Expected, and neither colour nor structure are those of a neighbour."""
    is_covered: Bool[np.ndarray, "V P"]
    """Disagrees, and so does nearly all that is near."""
    judged: Float[np.ndarray, " V"]
    """Share of each photo's area that has expected points; NaN for photos that say nothing."""


def compare_photos(seen: Observations, light: PhotoLight) -> Disagreement:
    """Compare every photo with its neighbours at the points that it should show."""
    neutral = np.stack(
        [
            light.neutral(
                row,
                seen.colors[row],
                np.nan_to_num(from_middle(view.width, view.height, seen.places[row])),
            )
            for row, view in enumerate(seen.views)
        ]
    ).astype(np.float32)
    toward, distance = directions(seen)
    shape = seen.is_shown.shape
    expected, disagrees = np.zeros(shape, bool), np.zeros(shape, bool)
    says = says_something(seen)
    tracked = seen.is_tracked & says[:, None]
    for row in np.flatnonzero(says).tolist():
        others = neighbours(row, tracked, toward, distance)
        is_there = others >= 0
        expected[row] = seen.is_shown[row] & (is_there.sum(axis=0) >= FEWEST_NEIGHBOURS)
        same = np.zeros(shape[1], bool)
        for other, there in zip(others, is_there, strict=True):
            which = np.flatnonzero(expected[row] & there)
            pair = other[which], which
            step = np.abs(neutral[row, which] - neutral[pair]).max(axis=-1)
            same[which] |= (step < COLOR_STEP) | are_alike(seen, (row, which), pair)
        disagrees[row] = expected[row] & ~same
    covered, judged = np.zeros(shape, bool), np.full(shape[0], np.nan)
    for row in np.flatnonzero(says).tolist():
        covered[row], judged[row] = _gathered(seen, row, expected[row], disagrees[row])
    return Disagreement(expected, disagrees, covered, judged)


def says_something(seen: Observations) -> Bool[np.ndarray, " V"]:
    """Photos that are not black or white nearly all over."""
    clipped = (seen.is_clipped & seen.is_shown).sum(axis=1)
    return clipped <= CLIPPED_PHOTO * seen.is_shown.sum(axis=1)


def _gathered(
    seen: Observations, row: int, expected: np.ndarray, disagrees: np.ndarray
) -> tuple[np.ndarray, float]:
    """Expected points of one photo in whose surroundings nearly all disagree; area judged."""
    view, which = seen.views[row], np.flatnonzero(expected)
    covered = np.zeros(len(expected), bool)
    if len(which) == 0:
        return covered, 0.0
    places = seen.places[row, which].astype(np.float64)
    share, count = near_means(view, places, disagrees[which].astype(float))
    covered[which] = disagrees[which] & (count >= FEWEST_NEAR) & (share >= VOTE)
    return covered, _area(view, places)


def _area(view, places: np.ndarray) -> float:
    """Share of squares of 3 by 3 cells that hold a place."""
    rows, columns = cells_of(view, places)
    last = cells_of(view, np.array([[view.width - 1e-6, view.height - 1e-6]]))
    squares = np.unique(np.stack([rows // 3, columns // 3]), axis=1).shape[1]
    return squares / float((last[0][0] // 3 + 1) * (last[1][0] // 3 + 1))


def distractor_figures(seen: Observations, found: Disagreement) -> tuple[Figure, ...]:
    """What the photos say, the deciding figure first, then the share of their area it is from."""
    says = np.isfinite(found.judged)
    expected = found.is_expected[says].sum(axis=1)
    shares = (found.is_covered[says].sum(axis=1) / np.maximum(expected, 1))[expected > 0]
    # One photo may be at fault itself (a wrong pose, a finger): the worst one does not count.
    rest = np.sort(shares)[:-1] if len(shares) > 2 else shares
    unseen = found.is_expected & ~seen.is_tracked
    missing = unseen.sum()
    return (
        Figure(
            "covered",
            float(rest.mean()) if len(rest) else float("nan"),
            "share of expected points, mean of the photos but the worst, where all near disagree",
            COVERED_SHARE,
        ),
        Figure(
            "judged",
            float(np.nanmean(found.judged)) if says.any() else 0.0,
            f"share of the photos' area that has expected points; needed is {JUDGED_SHARE:.2f}",
        ),
        Figure(
            "photos_covered",
            float((shares > 10 * COVERED_SHARE).mean()) if len(shares) else float("nan"),
            f"share of photos with more than {10 * COVERED_SHARE:.0%} of their points covered",
        ),
        Figure(
            "lost_points",
            float(found.disagrees[unseen].mean()) if missing else float("nan"),
            "share that disagrees of the expected points that a photo did not observe",
        ),
    )


def distractor_finding(seen: Observations, figures: tuple[Figure, ...]) -> Finding:
    """Decide whether distractors are needed.

    Args:
        figures: of `distractor_figures`.
    """
    covered, judged, unknown = figures[0], figures[1], _unknown(seen)
    if covered.is_above:
        reason = "Some photos do not show what their neighbours see at the same places."
        sure = confidence_of([covered])
        return Finding(EFFECT, True, sure, reason, figures, unknown)
    if not judged.value >= JUDGED_SHARE:
        reason = "Too little of the photos can be compared; with distractors nothing is lost."
        return Finding(EFFECT, True, "none", reason, figures, unknown)
    reason = "Photos show what their neighbours see, wherever they can be compared."
    enough = Figure("judged", judged.value, judged.meaning, JUDGED_SHARE)
    sure = confidence_of([covered, enough])
    return Finding(EFFECT, False, sure, reason, figures, unknown)


def _unknown(seen: Observations) -> tuple[str, ...]:
    silent = [name for name, says in zip(seen.names, says_something(seen), strict=True) if not says]
    lines = ["what stands where the reconstruction has no points, such as before the sky"]
    if silent:
        lines.append(
            f"anything about {len(silent)} photos that are black or white nearly all over: "
            f"{list_names(silent, 5)}"
        )
    if not seen.has_tracks:
        lines.append("which photo observed which point: there are no tracks")
    return tuple(lines)
