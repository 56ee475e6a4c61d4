"""Whether photos differ in their light: not at all, as a whole (`camera`), or place by place. Where
neighbours do not show the same of a point, something is in the way, which is no light.

Letters in shapes: V photos, P points, M pairs of patches, S samples of a patch.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.cameras.view_pairs import views_beside
from desplat_ns.survey.findings import Finding, confidence_of
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
NEAR_ANGLE = 30.0
"""Degrees between the directions of two photos up to which a point looks much alike in both."""
NEIGHBOURS, FEWEST_NEIGHBOURS = 3, 2
"""Photos with which a point is compared, the nearest in direction, and how many there must be."""
COLOR_STEP = 0.12
"""Of the range of values, in the light common to all photos, below which two show the same."""
SAME_STRUCTURE, MATCHED_STRUCTURE = 0.5, 0.9
"""Normalized cross-correlation of two patches above which they show the same, and where there are
no tracks and patches alone say that two photos show one point."""
FLAT = 0.012
"""Standard deviation of brightness below which a patch has no structure: three of 255 levels."""


def change_of_photos(light: PhotoLight) -> Float[np.ndarray, " K"]:
    """RMS of the values' relative change by the light of each photo with `FEWEST` observations."""
    counts = np.bincount(light.photo)
    squares = (light.weight * np.expm1(light.change) ** 2).sum(axis=1)
    sums = (np.bincount(light.photo, each) for each in (squares, light.weight.sum(axis=1)))
    total, weight = (each[counts >= FEWEST] for each in sums)
    return np.sqrt(total / weight)


def local_steps(
    observations: Observations, light: PhotoLight, is_confirmed: Bool[np.ndarray, "V P"]
) -> Float[np.ndarray, "V P"]:
    """What a photo's light leaves at each point and near it, in log; the lesser of both.

    0 where they contradict each other, NaN where too little is near or it is not `confirmed`. The
    residual is the channels' median; it is enlarged by what the point's colour took of it: n photos
    leave (n - 1) / n.
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
    the direction, as gloss does, and 0 where each photo has its own light. Least squares of their
    mean steps on a photo's own."""
    theirs, count = np.zeros((2, *steps.shape))
    for row, points, others in neighbours(observations, np.isfinite(steps)):
        theirs[row, points] += steps[others, points]
        count[row, points] += 1
    large = (np.abs(steps) > LOCAL_STEP) & (count > 0)
    own = steps[large]
    share = (theirs[large] / count[large] * own).sum() / max((own**2).sum(), 1e-12)
    return float(share.clip(0, 1))


def appearance_finding(
    observations: Observations, light: PhotoLight, steps: Float[np.ndarray, "V P"]
) -> Finding:
    """Decide how photos' light is to be explained; `steps` are those of `local_steps`.

    Figures: `change` of values by a photo's own light, of the median photo; `explained`, the share
    of the variance between photos that their light explains; `local`, the share of places that are
    off by more than `LOCAL_STEP` together with what is near, less what photos from nearly the same
    direction show, too.
    """
    known = change_of_photos(light)
    change, top = np.quantile(known, [0.5, 0.9]).tolist() if len(known) else (np.nan, np.nan)
    before, after = robust_spread(light.residual_before), robust_spread(light.residual)
    explained = 1 - (after / before) ** 2 if before > 0 else np.nan
    is_off = np.abs(steps[np.isfinite(steps)]) > LOCAL_STEP
    places = float(is_off.mean()) if is_off.size else np.nan
    local = places * (1 - share_by_direction(observations, steps))
    figures = {"change": change, "explained": explained, "local": local}
    decision, sure = "off", confidence_of((change, EIGHTH_STOP), (local, LOCAL_SHARE))
    as_a_whole = (
        f"half of the photos are off by {change:.1%} or more as a whole "
        f"(above {EIGHTH_STOP:.0%} it counts)"
    )
    reason = f"Photos show the same colours: {as_a_whole}."
    if len(known) < 2:
        sure = "none"
        reason = "Fewer than two photos show enough common points to compare their colours."
    elif local > LOCAL_SHARE and change > EIGHTH_STOP:
        decision = "affine"
        reason = (
            f"Light changes from place to place: {local:.1%} of the places are lighter or "
            f"darker in one photo alone (above {LOCAL_SHARE:.1%} it counts)."
        )
    elif change > EIGHTH_STOP and explained > LEAST_EXPLAINED:
        decision = "camera"
        reason = (
            f"Photos differ in exposure, white balance, contrast or dark corners: {as_a_whole}."
        )
    elif top > HALF_STOP:
        sure = "close"
        reason = (
            f"Most photos show the same colours; a tenth are off by {top:.0%} or more, which "
            "`camera` would explain."
        )
    return Finding("appearance", decision, sure, reason, figures)


# --- neighbours at a point ------------------------------------------------------------------------


def neighbours(
    observations: Observations, has_point: Bool[np.ndarray, "V P"]
) -> Iterator[tuple[int, Int[np.ndarray, " N"], Int[np.ndarray, " N"]]]:
    """For each photo its number, points, and for each of these points another photo that found it
    (`has_point`). There are at most `NEIGHBOURS` such triples for a photo: first the photos with
    the direction nearest to its own, point by point, then the second nearest, and so on."""
    centers = np.array([view.position for view in observations.views])
    numbers = np.arange(len(centers))
    for row in range(len(centers)):
        degrees, _, others = views_beside(row, numbers, has_point, observations.xyz, centers)
        near = others[degrees < NEAR_ANGLE]
        have = has_point[near]
        for chosen in np.argsort(~have, axis=0, kind="stable")[:NEIGHBOURS]:
            points = np.flatnonzero(have[chosen, np.arange(have.shape[1])])
            yield row, points, near[chosen[points]]


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
    same, count = np.zeros_like(observations.is_shown), np.zeros(observations.is_shown.shape)
    for row, points, others in neighbours(observations, observations.is_tracked):
        step = np.abs(neutral[row, points] - neutral[others, points]).max(axis=-1)
        alike = are_alike(patches[row, points], patches[others, points])
        same[row, points] |= (step < COLOR_STEP) | alike
        count[row, points] += 1
    return same & observations.is_shown & (count >= FEWEST_NEIGHBOURS)


def matched_points(observations: Observations) -> Bool[np.ndarray, "V P"]:
    """Which photos show a point as at least `FEWEST_NEIGHBOURS` of the nearest do that have it in
    view: what stands for tracks where there are none."""
    patches, votes = observations.structures, np.zeros(observations.is_shown.shape)
    for row, points, others in neighbours(observations, observations.is_shown):
        mine, theirs = patches[row, points], patches[others, points]
        votes[row, points] += are_alike(mine, theirs, MATCHED_STRUCTURE)
    return observations.is_shown & (votes >= FEWEST_NEIGHBOURS)
