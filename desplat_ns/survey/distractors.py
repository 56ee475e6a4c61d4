"""Whether things stand before the scene in some photos only.

Nothing is observed under a distractor, so what counts are the points that a photo should show:
at least two photos from nearly the same direction and distance found them. The photo disagrees
about such a point if neither colour nor structure are those of any of these neighbours.
A distractor is where a photo disagrees about nearly all points near one another; glints, edges
and inaccurate points are scattered.
Letters in shapes: V photos, P points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from desplat_ns.console import list_names
from desplat_ns.survey.findings import NO_TRACKS, Figure, Finding, confidence_of, mean_of
from desplat_ns.survey.matching import FEWEST_NEIGHBOURS, are_alike, directions, neighbours
from desplat_ns.survey.observations import Observations
from desplat_ns.survey.photo_light import PhotoLight, from_middle
from desplat_ns.survey.views import View

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

    @property
    def is_confirmed(self) -> Bool[np.ndarray, "V P"]:
        """Expected, and a neighbour shows the same."""
        return self.is_expected & ~self.disagrees


def compare_photos(observations: Observations, light: PhotoLight) -> Disagreement:
    """Compare every photo with its neighbours at the points that it should show."""
    rho2 = [
        from_middle(view.size, places)
        for view, places in zip(observations.views, observations.places, strict=True)
    ]
    neutral = np.stack(
        [
            light.neutral(row, observations.colors[row], np.nan_to_num(r))
            for row, r in enumerate(rho2)
        ]
    ).astype(np.float32)
    toward, distance = directions(observations)
    says, shape = says_something(observations), observations.is_shown.shape
    tracked = observations.is_tracked & says[:, None]
    disagreement = Disagreement(*np.zeros((3, *shape), bool), judged=np.full(len(says), np.nan))
    for row in np.flatnonzero(says).tolist():
        others = neighbours(row, tracked, toward, distance)
        is_there = others >= 0
        expected = observations.is_shown[row] & (is_there.sum(axis=0) >= FEWEST_NEIGHBOURS)
        same = np.zeros(shape[1], bool)
        for other, there in zip(others, is_there, strict=True):
            which = np.flatnonzero(expected & there)
            pair = other[which], which
            step = np.abs(neutral[row, which] - neutral[pair]).max(axis=-1)
            same[which] |= (step < COLOR_STEP) | are_alike(observations, (row, which), pair)
        disagrees = expected & ~same
        disagreement.is_expected[row], disagreement.disagrees[row] = expected, disagrees
        view, places = (
            observations.views[row],
            observations.places[row, expected].astype(np.float64),
        )
        share, count = view.near_means(places, disagrees[expected].astype(float))
        disagreement.is_covered[row, expected] = (count >= FEWEST_NEAR) & (share >= VOTE)
        disagreement.is_covered[row] &= disagrees
        disagreement.judged[row] = _area(view, places)
    return disagreement


def says_something(observations: Observations) -> Bool[np.ndarray, " V"]:
    """Photos that are not black or white nearly all over."""
    clipped = (observations.is_clipped & observations.is_shown).sum(axis=1)
    return clipped <= CLIPPED_PHOTO * observations.is_shown.sum(axis=1)


def _area(view: View, places: np.ndarray) -> float:
    """Share of squares of 3 by 3 cells that hold a place."""
    rows, columns = view.cells_of(places)
    last_row, last_column = view.cells_of(np.array([view.size]) - 1e-6)
    squares = np.unique(np.stack([rows // 3, columns // 3]), axis=1).shape[1]
    return squares / float((last_row[0] // 3 + 1) * (last_column[0] // 3 + 1))


def distractor_finding(observations: Observations, disagreement: Disagreement) -> Finding:
    """Decide whether distractors are needed."""
    figures, unknown = _figures(observations, disagreement), _unknown(observations)
    covered, judged = figures[0], replace(figures[1], threshold=JUDGED_SHARE)
    if covered.is_above:
        reason = "Some photos do not show what their neighbours see at the same places."
        sure = confidence_of([covered])
        return Finding("distractors", True, sure, reason, figures, unknown)
    if not judged.value >= JUDGED_SHARE:
        reason = (
            f"Not judged: only {judged.value:.0%} of the photos' area can be compared. Distractors "
            "stay on; nothing is lost by that."
        )
        return Finding("distractors", True, "none", reason, figures, unknown)
    reason = "Photos show what their neighbours see, wherever they can be compared."
    return Finding("distractors", False, confidence_of([covered, judged]), reason, figures, unknown)


def _figures(observations: Observations, disagreement: Disagreement) -> tuple[Figure, ...]:
    """What the photos say, the deciding figure first, then the share of their area it is from."""
    says = np.isfinite(disagreement.judged)
    expected = disagreement.is_expected[says].sum(axis=1)
    shares = (disagreement.is_covered[says].sum(axis=1) / np.maximum(expected, 1))[expected > 0]
    # One photo may be at fault itself (a wrong pose, a finger): the worst one does not count.
    rest = np.sort(shares)[:-1] if len(shares) > 2 else shares
    return (
        Figure(
            "covered",
            mean_of(rest),
            "share of expected points, mean of the photos but the worst, where all near disagree",
            COVERED_SHARE,
        ),
        Figure(
            "judged",
            float(np.nanmean(disagreement.judged)) if says.any() else 0.0,
            f"share of the photos' area that has expected points; needed is {JUDGED_SHARE:.2f}",
        ),
        Figure(
            "photos_covered",
            mean_of(shares > 10 * COVERED_SHARE),
            f"share of photos with more than {10 * COVERED_SHARE:.0%} of their points covered",
        ),
        Figure(
            "lost_points",
            mean_of(disagreement.disagrees[disagreement.is_expected & ~observations.is_tracked]),
            "share that disagrees of the expected points that a photo did not observe",
        ),
    )


def _unknown(observations: Observations) -> tuple[str, ...]:
    silent = [
        name
        for name, says in zip(observations.names, says_something(observations), strict=True)
        if not says
    ]
    lines = ["what stands where the reconstruction has no points, such as before the sky"]
    if silent:
        lines.append(
            f"anything about {len(silent)} photos that are black or white nearly all over: "
            f"{list_names(silent, 5)}"
        )
    return tuple(lines) if observations.has_tracks else (*lines, NO_TRACKS)
