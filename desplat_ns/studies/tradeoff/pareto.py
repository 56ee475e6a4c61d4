"""What is worth its price: points of (cost, error), both the less the better."""

from __future__ import annotations

import math
from collections.abc import Sequence

CostAndError = tuple[float, float]


def front(points: Sequence[CostAndError]) -> set[int]:
    """Indices of the points that no other dominates, the Pareto front.

    A point dominates another if it is no worse in either and better in one. Equal points share
    their fate. NaN is no figure: such a point is on no front and dominates none.
    """
    known = [i for i, point in enumerate(points) if not any(map(math.isnan, point))]
    found: set[int] = set()
    least, last = math.inf, None
    for i in sorted(known, key=lambda i: points[i]):
        if points[i][1] < least or last is None or points[i] == last:
            found.add(i)
            least, last = points[i][1], points[i]
    return found
