"""Which pairs of photos are matched: all, neighbours in a video, or those that look alike.

How alike photos look follows from their features alone, by VLAD (Jégou et al., Aggregating Local
Descriptors into a Compact Image Representation, CVPR 2010): the features of a photo are summed up
as their differences from the nearest of a few words, which are learned from the same photos.
Letters in shapes: N photos, F features, D numbers of a descriptor, W words.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float32

ALL_PAIRS_UP_TO = 200
"""Photos: 19,900 pairs. Above, pairs by image similarity."""
OVERLAP = 10
"""Frames of a video that each is matched with before and after it; then every doubled distance."""
LOOPS = 5
"""Of a video's frames further away, so many that look most alike."""
WORDS = 64
SAMPLES = 100_000
"""Features that the words are learned from, at most."""

Pair = tuple[int, int]
"""Two photos by their places in the list, the smaller first."""


def sequential_pairs(count: int) -> list[Pair]:
    """Neighbours, and further ones at doubling distances."""
    steps = [*range(1, OVERLAP + 1), *(OVERLAP * 2**k for k in range(1, 12))]
    return sorted((i, i + step) for i in range(count) for step in steps if i + step < count)


def similar_pairs(likeness: Float32[np.ndarray, "N N"], neighbours: int) -> list[Pair]:
    """For each photo those most like it; a pair is in if one of both asks for it."""
    scores = likeness.copy()
    np.fill_diagonal(scores, -np.inf)
    order = np.argsort(-scores, axis=1, kind="stable")[:, : min(neighbours, len(scores) - 1)]
    pairs = {(min(i, int(j)), max(i, int(j))) for i, row in enumerate(order) for j in row}
    return sorted(pairs)


def similarities(
    count: int, descriptors: Callable[[int], Float32[np.ndarray, "_ D"]]
) -> Float32[np.ndarray, "N N"]:
    """Cosines between photos, in [-1, 1]; 0 for photos without features.

    Args:
        count: of the photos.
        descriptors: gives those of a photo. It is asked twice for each, one after another: those
            of 2,000 photos are 8 GB, and need not be in memory together.
    """
    rng = np.random.default_rng(0)
    each = max(1, SAMPLES // max(1, count))
    photos = (descriptors(i) for i in range(count))
    some = [photo[rng.permutation(len(photo))[:each]] for photo in photos]
    words = _words(np.concatenate(some, dtype=np.float32))
    vectors = np.stack([_vlad(descriptors(i), words) for i in range(count)])
    return vectors @ vectors.T


def _words(samples: Float32[np.ndarray, "F D"]) -> Float32[np.ndarray, "W D"]:
    """Centres of the samples' clusters."""
    if len(samples) == 0:
        return np.zeros((1, samples.shape[1]), np.float32)
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-4)
    labels = np.empty((0,), np.int32)
    count = min(WORDS, len(samples))
    return cv2.kmeans(samples, count, labels, criteria, 1, cv2.KMEANS_PP_CENTERS)[2]


def _vlad(
    features: Float32[np.ndarray, "F D"], words: Float32[np.ndarray, "W D"]
) -> Float32[np.ndarray, " WD"]:
    """One vector of length 1, or of zeros without features."""
    sums = np.zeros_like(words)
    if len(features):
        # |f - w|^2 without |f|^2, which is the same for all words
        nearest = ((words**2).sum(1) - 2 * features @ words.T).argmin(1)
        np.add.at(sums, nearest, features - words[nearest])
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    vector = (sums / np.maximum(norms, 1e-9)).ravel()
    return (vector / max(float(np.linalg.norm(vector)), 1e-9)).astype(np.float32)
