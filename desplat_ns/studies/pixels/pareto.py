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


def excess(points: Sequence[CostAndError]) -> list[float]:
    """Each point's cost over the least cost at which its error, or a smaller one, is to be had.

    1 on the front. Times are noisy, and which of two close points is on the front may change from
    run to run: 1.02 says that nothing as exact is cheaper by more than 2%. NaN where a figure is.
    """
    return [
        cost / min((c for c, e in points if e <= error and not math.isnan(c)), default=math.nan)
        for cost, error in points
    ]
