"""Whether photos differ in their light: not at all, as a whole (`camera`), or place by place.

Letters in shapes: V photos, P points, M observations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from desplat_ns.console import list_names
from desplat_ns.survey.findings import (
    NO_TRACKS,
    Confidence,
    Decision,
    Figure,
    Finding,
    confidence_of,
    mean_of,
)
from desplat_ns.survey.observations import Observations
from desplat_ns.survey.photo_light import FEWEST, PhotoLight, robust_spread

DISPLAY_GAMMA = 2.2
"""Between light and the values of files: a stop is a factor of 2^(1/2.2) in values."""

QUARTER_STOP = 2 ** (0.25 / DISPLAY_GAMMA) - 1
"""8%. Cameras' dials have thirds of a stop; half of the photos off by nearly as much is seen."""

HALF_STOP = 2 ** (0.5 / DISPLAY_GAMMA) - 1
"""17%. If a tenth of the photos are off by as much and most are not, it is said beside."""

EIGHTH_STOP = 2 ** (0.125 / DISPLAY_GAMMA) - 1
"""4%. A light that moves changes photos as a whole, too: the median one by 9.6% or more where a sun
alone moved by 40 degrees. Gloss, and detail finer than a pixel, make places differ as well, in
photos that a light of their own changes by 1.1% at most."""

LOCAL_STEP = 0.15
"""Of the value: a place is another one's shade if it and what is near are off by more than this.
A surface in the sun has 1.3 to 2 times the value of one in the shade."""

LOCAL_SHARE = 0.04
"""Share of the places. It was set between 0.023, the most that edges made where the light stands
still and nothing is fine or glossy, and 0.061, the least where the sun moved."""

LEAST_EXPLAINED = 0.3
"""Share of the variance between photos that their lights must explain to be believed."""

FEW_NEAR = 3
"""Other observations near a place without which it says nothing."""


def change_of_photos(light: PhotoLight) -> Float[np.ndarray, " V"]:
    """How much each photo's light changes what it shows: RMS of the values' relative change.

    NaN where fewer than `FEWEST` observations count.
    """
    changes = np.full(len(light.gains), np.nan)
    ends = np.searchsorted(light.photo, np.arange(len(changes) + 1))
    for row in np.flatnonzero(light.counts() >= FEWEST):
        part = slice(ends[row], ends[row + 1])
        squares = np.expm1(light.change[part]) ** 2
        changes[row] = np.sqrt(np.average(squares, weights=light.weight[part]))
    return changes


def local_steps(
    observations: Observations, light: PhotoLight, is_confirmed: Bool[np.ndarray, "V P"]
) -> Float[np.ndarray, " M"]:
    """What a photo's light leaves at each observation and near it, in log; the lesser of both.

    0 where they contradict each other, NaN where too little is near. The residual is the channels'
    median; it is enlarged by what the point's colour took of it: n photos leave (n - 1) / n.

    Args:
        is_confirmed: where a photo and a neighbour show the same of the point. Elsewhere something
            may be in the way, which is no light: NaN.
    """
    photos = np.bincount(light.point, minlength=len(observations.xyz))[light.point]
    own = np.median(light.residual, axis=1) * photos / np.maximum(photos - 1, 1)
    steps, counts = np.full(len(own), np.nan), is_confirmed[light.photo, light.point]
    for row, view in enumerate(observations.views):
        part = np.flatnonzero((light.photo == row) & counts)
        places = observations.places[row, light.point[part]]
        near, count = view.near_means(places, np.clip(own[part], -0.5, 0.5))
        agree = np.sign(near) == np.sign(own[part])
        lesser = np.where(agree, np.minimum(np.abs(near), np.abs(own[part])), 0.0)
        steps[part] = np.where(count >= FEW_NEAR, lesser * np.sign(near), np.nan)
    return steps


def appearance_finding(
    observations: Observations, light: PhotoLight, is_confirmed: Bool[np.ndarray, "V P"]
) -> Finding:
    """Decide how photos' light is to be explained.

    Args:
        is_confirmed: see `local_steps`.
    """
    changes = change_of_photos(light)
    known = changes[np.isfinite(changes)]
    middle, top = np.quantile(known, [0.5, 0.9]).tolist() if len(known) else (np.nan, np.nan)
    what = "change of values by a photo's own light, median photo"
    median = Figure("change", middle, what, QUARTER_STOP)
    largest = Figure("largest_changes", top, "the same, exceeded by a tenth of the photos")
    before, after = robust_spread(light.residual_before), robust_spread(light.residual)
    share = 1 - (after / before) ** 2 if before > 0 else np.nan
    explained = Figure(
        "explained", share, "share of the variance between photos that their light explains"
    )
    steps = local_steps(observations, light, is_confirmed)
    local = Figure(
        "local",
        mean_of(np.abs(steps[np.isfinite(steps)]) > LOCAL_STEP),
        f"share of places off by more than {LOCAL_STEP:.0%} together with what is near",
        LOCAL_SHARE,
    )
    figures = (median, largest, local, explained, *_beside(light))
    unknown = _unknown(observations, changes)
    if len(known) < 2:
        reason = "Fewer than two photos show enough common points to compare their colours."
        return Finding("appearance", "off", "none", reason, figures, unknown)
    decision, sure, reason = _decided(median, largest, local, explained)
    return Finding("appearance", decision, sure, reason, figures, unknown)


def _decided(
    median: Figure, top: Figure, local: Figure, explained: Figure
) -> tuple[Decision, Confidence, str]:
    """What the figures call for, how sure that is, and why."""
    moved = replace(median, threshold=EIGHTH_STOP)
    if local.is_above and moved.is_above:
        reason = "Light changes from place to place: shadows move, or sun and clouds alternate."
        return "affine", confidence_of([local, moved]), reason
    sure = confidence_of([median, local])
    if median.is_above and explained.value > LEAST_EXPLAINED:
        return "camera", sure, "Photos differ in exposure, white balance or contrast as a whole."
    if top.value > HALF_STOP:
        reason = (
            "Most photos show the same colours; a tenth are off by half a stop or more, which "
            "`camera` would explain."
        )
        return "off", "close", reason
    if local.is_above:
        reason = "Places differ, but no photo as a whole: gloss, or detail finer than a pixel."
        return "off", confidence_of([moved]), reason
    return "off", sure, "Photos show the same colours, as far as the eye would notice."


def _beside(light: PhotoLight) -> list[Figure]:
    """What decides nothing."""
    usable = light.counts() >= FEWEST
    gains, gammas = light.gains[usable], light.gammas[usable]
    colors = gains - gains.mean(axis=1, keepdims=True)
    values = [
        ("exposure", gains.mean(axis=1), "photos' gains, standard deviation in log of the values"),
        ("white_balance", colors, "the same of each channel against the photo's mean"),
        ("contrast", gammas, "photos' gammas, standard deviation"),
        ("vignetting", light.vignetting[usable], "corners against the middle, standard deviation"),
    ]
    return [Figure(n, float(v.std()) if v.size else float("nan"), what) for n, v, what in values]


def _unknown(observations: Observations, changes: np.ndarray) -> tuple[str, ...]:
    lines = []
    missing = [
        name for name, change in zip(observations.names, changes, strict=True) if np.isnan(change)
    ]
    if missing:
        lines.append(
            f"the light of {len(missing)} photos that show fewer than {FEWEST} known points with "
            f"values that are not clipped: {list_names(missing, 5)}"
        )
    return tuple(lines) if observations.has_tracks else (*lines, NO_TRACKS)
