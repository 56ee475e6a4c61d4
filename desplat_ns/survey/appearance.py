"""Whether photos differ in their light: not at all, as a whole (`camera`), or place by place. Where
neighbours do not show the same of a point, something is in the way, which is no light.

Letters in shapes: V photos, P points, M pairs of patches, S samples of a patch.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.survey.findings import Confidence, Figure, Finding, confidence_of
from desplat_ns.survey.observations import Observations
from desplat_ns.survey.photo_light import FEWEST, PhotoLight, from_middle, robust_spread

DISPLAY_GAMMA = 2.2
"""Between light and the values of files: a stop is a factor of 2^(1/2.2) in values."""
HALF_STOP = 2 ** (0.5 / DISPLAY_GAMMA) - 1
"""17%. If a tenth of the photos are off by as much and most are not, it is said beside."""
EIGHTH_STOP = 2 ** (0.125 / DISPLAY_GAMMA) - 1
"""4%. docs/explain/survey.md has the reasons of this and the other thresholds."""
LOCAL_STEP = 0.15
"""Of the value: a place is another one's shade if it and what is near are off by more than this.
A surface in the sun has 1.3 to 2 times the value of one in the shade."""
LOCAL_SHARE = 0.035
"""Share of the places."""
LEAST_EXPLAINED = 0.3
"""Share of the variance between photos that their lights must explain to be believed."""
FEW_NEAR = 3
"""Other observations near a place without which it says nothing."""
NEAR_ANGLE, NEAR_DISTANCE = 30.0, 2.0
"""Degrees between two directions to a point, and the ratio of two distances from it, up to which
its surroundings look much alike."""
NEIGHBOURS, FEWEST_NEIGHBOURS = 3, 2
"""Photos with which a point is compared, the nearest in direction, and how many there must be."""
COLOR_STEP = 0.12
"""Of the range of values, in the light common to all photos, below which two show the same."""
SAME_STRUCTURE, MATCHED_STRUCTURE = 0.5, 0.9
"""Normalized cross-correlation of two patches above which they show the same, and where there are
no tracks and patches alone say that two photos show one point."""
FLAT = 0.012
"""Standard deviation of a patch's brightness below which it has no structure to compare: three of
255 levels."""


def change_of_photos(light: PhotoLight) -> Float[np.ndarray, " K"]:
    """How much the light of each photo with `FEWEST` observations changes what it shows: RMS of the
    values' relative change."""
    counts = np.bincount(light.photo)
    squares = (light.weight * np.expm1(light.change) ** 2).sum(axis=1)
    sums = (np.bincount(light.photo, each) for each in (squares, light.weight.sum(axis=1)))
    total, weight = (each[counts >= FEWEST] for each in sums)
    return np.sqrt(total / weight)


def local_steps(
    observations: Observations, light: PhotoLight, is_confirmed: Bool[np.ndarray, "V P"]
) -> Float[np.ndarray, "V P"]:
    """What a photo's light leaves at each point and near it, in log; the lesser of both.

    0 where they contradict each other, NaN where too little is near or the point does not count.
    The residual is the channels' median; it is enlarged by what the point's colour took of it: n
    photos leave (n - 1) / n.

    Args:
        is_confirmed: where a photo and a neighbour show the same of the point. Elsewhere something
            may be in the way, which is no light: NaN.
    """
    photos = np.bincount(light.point, minlength=len(observations.xyz))[light.point]
    own = np.median(light.residual, axis=1) * photos / np.maximum(photos - 1, 1)
    steps, counts = np.full(is_confirmed.shape, np.nan), is_confirmed[light.photo, light.point]
    for row, view in enumerate(observations.views):
        part = np.flatnonzero((light.photo == row) & counts)
        point = light.point[part]
        places = observations.places[row, point]
        near, count = view.near_means(places, np.clip(own[part], -0.5, 0.5))
        agree = np.sign(near) == np.sign(own[part])
        lesser = np.where(agree, np.minimum(np.abs(near), np.abs(own[part])), 0.0)
        steps[row, point] = np.where(count >= FEW_NEAR, lesser * np.sign(near), np.nan)
    return steps


def share_by_direction(observations: Observations, steps: Float[np.ndarray, "V P"]) -> float:
    """How much of the large steps the neighbours show, too, in [0, 1]: about 1 where colours follow
    the direction, as gloss does, and 0 where each photo has its own light, or no place has
    neighbours. Least squares of their mean steps on a photo's own."""
    product = square = 0.0
    for row, others in enumerate(neighbours(observations, np.isfinite(steps))):
        theirs = np.where(others >= 0, np.take_along_axis(steps, np.maximum(others, 0), axis=0), 0)
        count = (others >= 0).sum(axis=0)
        large = (np.abs(steps[row]) > LOCAL_STEP) & (count > 0)
        mean = theirs.sum(axis=0)[large] / count[large]
        product += float((mean * steps[row, large]).sum())
        square += float((steps[row, large] ** 2).sum())
    return min(max(product / square, 0.0), 1.0) if square > 0 else 0.0


def appearance_finding(
    observations: Observations, light: PhotoLight, steps: Float[np.ndarray, "V P"]
) -> Finding:
    """Decide how photos' light is to be explained; `steps` are those of `local_steps`."""
    known = change_of_photos(light)
    middle, top = np.quantile(known, [0.5, 0.9]).tolist() if len(known) else (np.nan, np.nan)
    what = "change of values by a photo's own light, median photo"
    median = Figure("change", middle, what, EIGHTH_STOP)
    largest = Figure("largest_changes", top, "the same, exceeded by a tenth of the photos")
    before, after = robust_spread(light.residual_before), robust_spread(light.residual)
    share = 1 - (after / before) ** 2 if before > 0 else np.nan
    what = "share of the variance between photos that their light explains"
    explained = Figure("explained", share, what)
    is_off = np.abs(steps[np.isfinite(steps)]) > LOCAL_STEP
    places = float(is_off.mean()) if is_off.size else np.nan
    own = places * (1 - share_by_direction(observations, steps))
    what = f"share of places off by more than {LOCAL_STEP:.0%} together with what is near"
    less = f"{what}, less what photos from nearly the same direction show, too"
    local = Figure("local", own, less, LOCAL_SHARE)
    figures = (median, largest, local, explained, Figure("places", places, what))
    if len(known) < 2:
        reason = "Fewer than two photos show enough common points to compare their colours."
        return Finding("appearance", "off", "none", reason, figures)
    decision, sure, reason = _decided(median, largest, local, explained)
    return Finding("appearance", decision, sure, reason, figures)


def _decided(
    median: Figure, top: Figure, local: Figure, explained: Figure
) -> tuple[str, Confidence, str]:
    """What the figures call for, how sure that is, and why."""
    sure = confidence_of([median, local])
    as_a_whole = f"half of the photos are off by {median.value:.1%} or more as a whole"
    if local.is_above and median.is_above:
        reason = (
            f"Light changes from place to place: {local.value:.1%} of the places are lighter or "
            f"darker in one photo alone (above {LOCAL_SHARE:.1%} it counts)."
        )
        return "affine", sure, reason
    if median.is_above and explained.value > LEAST_EXPLAINED:
        reason = (
            f"Photos differ in exposure, white balance, contrast or dark corners: {as_a_whole} "
            f"(above {EIGHTH_STOP:.0%} it counts)."
        )
        return "camera", sure, reason
    if top.value > HALF_STOP:
        reason = (
            f"Most photos show the same colours; a tenth are off by {top.value:.0%} or more, which "
            "`camera` would explain."
        )
        return "off", "close", reason
    if local.is_above:
        reason = (
            f"Places differ ({local.value:.1%}), but photos as a whole by {median.value:.1%} only: "
            "gloss, or detail finer than a pixel."
        )
        return "off", confidence_of([median]), reason
    reason = f"Photos show the same colours: {as_a_whole} (above {EIGHTH_STOP:.0%} it counts)."
    return "off", sure, reason


# --- neighbours at a point ------------------------------------------------------------------------


def neighbours(
    observations: Observations, has_point: Bool[np.ndarray, "V P"]
) -> Iterator[Int[np.ndarray, "_ P"]]:
    """For each photo at most `NEIGHBOURS` that found each point (`has_point`), from the directions
    nearest to its own; -1 where there are not so many."""
    positions = np.array([view.position for view in observations.views])
    toward = observations.xyz[None] - positions[:, None]
    distance = np.maximum(np.linalg.norm(toward, axis=-1), 1e-12)
    toward = (toward / distance[..., None]).astype(np.float32)
    distance = distance.astype(np.float32)
    for row in range(len(toward)):
        cosine = np.einsum("vpk,pk->vp", toward, toward[row])
        ratio = distance / distance[row]
        fits = has_point & (cosine > np.cos(np.radians(NEAR_ANGLE)))
        fits &= (ratio < NEAR_DISTANCE) & (ratio > 1 / NEAR_DISTANCE)
        fits[row] = False
        rank = np.where(fits, -cosine, 2.0)
        count = min(NEIGHBOURS, len(rank))
        nearest = np.argpartition(rank, count - 1, axis=0)[:count]
        yield np.where(np.take_along_axis(fits, nearest, axis=0), nearest, -1)


def are_alike(
    first: Float[np.ndarray, "M S"],
    second: Float[np.ndarray, "M S"],
    correlation: float = SAME_STRUCTURE,
) -> Bool[np.ndarray, " M"]:
    """Whether patches have the same structure, whatever the light; False where one has none."""
    norms = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    alike = (first * second).sum(axis=-1) > correlation * norms[0] * norms[1]
    return alike & (np.minimum(*norms) > FLAT * np.sqrt(first.shape[-1]))


def confirmed(observations: Observations, light: PhotoLight) -> Bool[np.ndarray, "V P"]:
    """Where a photo and one of its neighbours show the same of a point, in colour or in structure;
    False where fewer than `FEWEST_NEIGHBOURS` found it."""
    neutral, patches = np.zeros_like(observations.colors), observations.structures
    for row, view in enumerate(observations.views):
        rho2 = np.nan_to_num(from_middle(view.size, observations.places[row]))
        neutral[row] = light.neutral(row, observations.colors[row], rho2)
    same = np.zeros_like(observations.is_shown)
    for row, others in enumerate(neighbours(observations, observations.is_tracked)):
        expected = observations.is_shown[row] & ((others >= 0).sum(axis=0) >= FEWEST_NEIGHBOURS)
        for other in others:
            which = np.flatnonzero(expected & (other >= 0))
            pair = other[which], which
            step = np.abs(neutral[row, which] - neutral[pair]).max(axis=-1)
            same[row, which] |= (step < COLOR_STEP) | are_alike(patches[row, which], patches[pair])
    return same


def matched_points(observations: Observations) -> Bool[np.ndarray, "V P"]:
    """Which photos show a point as at least `FEWEST_NEIGHBOURS` of the nearest do that have it in
    view, for captures without tracks: one may have something before it, or look at its back."""
    shown, patches = observations.is_shown, observations.structures
    matched = np.zeros_like(shown)
    for row, others in enumerate(neighbours(observations, shown)):
        votes = np.zeros(matched.shape[1], int)
        for other in others:
            which = np.flatnonzero(shown[row] & (other >= 0))
            theirs = patches[other[which], which]
            votes[which] += are_alike(patches[row, which], theirs, MATCHED_STRUCTURE)
        matched[row] = votes >= FEWEST_NEIGHBOURS
    return matched
