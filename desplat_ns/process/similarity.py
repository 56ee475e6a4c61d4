"""How alike photos look, from their features alone, to choose the pairs that are matched.

VLAD (Jégou et al., Aggregating Local Descriptors into a Compact Image Representation, CVPR 2010):
the features of a photo are summed up as their differences from the nearest of a few words, which
are learned from the same photos. Letters in shapes: N photos, F features, D numbers of a
descriptor, W words.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32

WORDS = 64
SAMPLES = 100_000
"""Features that the words are learned from, at most."""


def similarities(
    descriptors: Sequence[Float32[np.ndarray, "_ D"]], seed: int = 0
) -> Float32[np.ndarray, "N N"]:
    """Cosines between photos, in [-1, 1]; 0 for photos without features."""
    words = _learn_words(descriptors, seed)
    vectors = np.stack([_vlad(one, words) for one in descriptors])
    return vectors @ vectors.T


def _learn_words(descriptors: Sequence[np.ndarray], seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    each = max(1, SAMPLES // max(1, len(descriptors)))
    samples = np.concatenate(
        [one[rng.permutation(len(one))[:each]] for one in descriptors], dtype=np.float32
    )
    cv2.setRNGSeed(seed)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-4)
    words = min(WORDS, max(1, len(samples)))
    if len(samples) == 0:
        return np.zeros((1, descriptors[0].shape[1]), np.float32)
    labels = np.empty((0,), np.int32)
    return cv2.kmeans(samples, words, labels, criteria, 1, cv2.KMEANS_PP_CENTERS)[2]


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
