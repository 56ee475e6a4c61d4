"""A median, and how far apart the single values are."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import TypedDict


class Summary(TypedDict):
    """Of several values of one thing, in their unit."""

    median: float
    low: float
    """A tenth of the values is smaller."""
    high: float
    """A tenth of the values is larger."""
    count: int


def summary(values: Sequence[float]) -> Summary:
    """Median and tenths of values; of a single one, that value."""
    if len(values) < 2:
        tenths = [values[0]] * 9
    else:
        tenths = statistics.quantiles(values, n=10, method="inclusive")
    return Summary(
        median=round(statistics.median(values), 4),
        low=round(tenths[0], 4),
        high=round(tenths[-1], 4),
        count=len(values),
    )
