"""Which photos are neighbours at a point, and whether they show the same of it.

Letters in shapes: V photos, P points, M pairs.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.survey.observations import Observations
from desplat_ns.survey.photo_light import PhotoLight, from_middle

NEAR_ANGLE = 30.0
"""Degrees between two directions to a point from which its surroundings look much alike."""

NEAR_DISTANCE = 2.0
"""The same for the ratio of the distances."""

NEIGHBOURS, FEWEST_NEIGHBOURS = 3, 2
"""Photos with which a point is compared, the nearest in direction, and how many there must be."""

COLOR_STEP = 0.12
"""Of the range of values, in the light common to all photos, below which two show the same: twice
what light leaves in photos of tourists, and less than between most things."""

SAME_STRUCTURE = 0.5
"""Normalized cross-correlation of two patches above which they show the same."""

MATCHED_STRUCTURE = 0.9
"""The same where there are no tracks and patches alone say that two photos show one point."""

FLAT = 0.012
"""Standard deviation of a patch's brightness below which it has no structure to compare: three of
255 levels."""


def directions(
    observations: Observations,
) -> tuple[Float[np.ndarray, "V P 3"], Float[np.ndarray, "V P"]]:
    """Unit vectors from the cameras to the points, and distances."""
    positions = np.array([view.position for view in observations.views])
    toward = observations.xyz[None] - positions[:, None]
    distance = np.maximum(np.linalg.norm(toward, axis=-1), 1e-12)
    return (toward / distance[..., None]).astype(np.float32), distance.astype(np.float32)


def neighbours(
    row: int,
    has_point: Bool[np.ndarray, "V P"],
    toward: Float[np.ndarray, "V P 3"],
    distance: Float[np.ndarray, "V P"],
) -> Int[np.ndarray, "_ P"]:
    """At most `NEIGHBOURS` photos that found each point, from the directions nearest to `row`'s.

    -1 where there are not so many.

    Args:
        has_point: which photos found which points.
        toward, distance: see `directions`.
    """
    cosine = np.einsum("vpk,pk->vp", toward, toward[row])
    ratio = distance / distance[row]
    fits = has_point & (cosine > np.cos(np.radians(NEAR_ANGLE)))
    fits &= (ratio < NEAR_DISTANCE) & (ratio > 1 / NEAR_DISTANCE)
    fits[row] = False
    rank = np.where(fits, -cosine, 2.0)
    count = min(NEIGHBOURS, len(rank))
    nearest = np.argpartition(rank, count - 1, axis=0)[:count]
    return np.where(np.take_along_axis(fits, nearest, axis=0), nearest, -1)


Pair = tuple[int | Int[np.ndarray, " M"], Int[np.ndarray, " M"]]
"""Photos and points."""


def are_alike(
    observations: Observations, pair: Pair, other: Pair, correlation: float = SAME_STRUCTURE
) -> Bool[np.ndarray, " M"]:
    """Whether patches have the same structure, whatever the light; False where one has none."""
    first, second = observations.structures[pair], observations.structures[other]
    norms = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    alike = (first * second).sum(axis=-1) > correlation * norms[0] * norms[1]
    return alike & (np.minimum(*norms) > FLAT * np.sqrt(first.shape[-1]))


def confirmed(observations: Observations, light: PhotoLight) -> Bool[np.ndarray, "V P"]:
    """Where a photo and one of its neighbours show the same of a point, in colour or in structure.

    False where fewer than `FEWEST_NEIGHBOURS` found the point.
    """
    neutral = np.zeros_like(observations.colors)
    for row, view in enumerate(observations.views):
        rho2 = np.nan_to_num(from_middle(view.size, observations.places[row]))
        neutral[row] = light.neutral(row, observations.colors[row], rho2)
    toward, distance = directions(observations)
    same = np.zeros_like(observations.is_shown)
    for row in range(len(same)):
        others = neighbours(row, observations.is_tracked, toward, distance)
        is_there = others >= 0
        expected = observations.is_shown[row] & (is_there.sum(axis=0) >= FEWEST_NEIGHBOURS)
        for other, there in zip(others, is_there, strict=True):
            which = np.flatnonzero(expected & there)
            pair = other[which], which
            step = np.abs(neutral[row, which] - neutral[pair]).max(axis=-1)
            same[row, which] |= (step < COLOR_STEP) | are_alike(observations, (row, which), pair)
    return same


def matched_points(observations: Observations) -> Bool[np.ndarray, "V P"]:
    """Which photos show a point as their neighbours do, for captures without tracks.

    At least `FEWEST_NEIGHBOURS` of the nearest photos that have it in view must agree: one may have
    something before it, or look at its back.
    """
    toward, distance = directions(observations)
    matched = np.zeros_like(observations.is_shown)
    for row in range(len(matched)):
        votes = np.zeros(matched.shape[1], int)
        for other in neighbours(row, observations.is_shown, toward, distance):
            which = np.flatnonzero(observations.is_shown[row] & (other >= 0))
            pair = (row, which), (other[which], which)
            votes[which] += are_alike(observations, *pair, MATCHED_STRUCTURE)
        matched[row] = votes >= FEWEST_NEIGHBOURS
    return matched
