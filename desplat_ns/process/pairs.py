"""Which pairs of photos are matched: all, neighbours in a video, or those that look alike."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from jaxtyping import Float32

ALL_PAIRS_UP_TO = 200
"""Photos: 19,900 pairs. Above, pairs by image similarity."""
OVERLAP = 10
"""Frames of a video that each is matched with before and after it; then every doubled distance."""
LOOPS = 5
"""Of a video's frames further away, so many that look most alike."""

Pair = tuple[int, int]
"""Two photos by their places in the list, the smaller first."""


def all_pairs(count: int) -> list[Pair]:
    """Every photo with every other, by blocks, so that what is read stays at hand."""
    return sorted(combinations(range(count), 2), key=lambda pair: (pair[1] // 50, pair))


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
