"""y = a + b x^p through measured points, and how well the measurements settle p."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

EXPONENTS = np.arange(0.05, 3.001, 0.01)
"""That are tried."""

FLAT = 0.25
"""Where y grows by less than this share from the first point to the last, no exponent is given:
nearly any would fit."""

RESAMPLED, MIDDLE = 300, (5, 95)
"""Fits to resampled measurements, and the percentiles of their exponents that are reported."""


@dataclass(frozen=True)
class PowerLaw:
    """y = constant + factor x^exponent."""

    constant: float
    """At least 0: no step takes less than no time."""
    factor: float
    exponent: float

    def at(self, x: float) -> float:
        """y at x."""
        return self.constant + self.factor * x**self.exponent


def fit(x: Sequence[float], y: Sequence[float]) -> PowerLaw:
    """The power law with the least sum of squared relative errors; its exponent to a hundredth.

    Args:
        x: positive, three different values at least.
        y: positive.

    Raises:
        ValueError: too few points.
    """
    if len(set(x)) < 3:
        raise ValueError(f"a power law has three unknowns; {len(set(x))} points cannot settle it")
    top, values = max(x), np.asarray(y, float)
    shares = np.asarray(x, float) / top
    fits = [_with_exponent(shares, values, p) for p in EXPONENTS]
    errors = [error for error, _, _ in fits]
    best = int(np.argmin(errors))
    _, constant, factor = fits[best]
    exponent = float(EXPONENTS[best])
    return PowerLaw(constant, factor / top**exponent, exponent)


def _with_exponent(x: np.ndarray, y: np.ndarray, p: float) -> tuple[float, float, float]:
    """Sum of squared relative errors, constant and factor of the best fit with an exponent."""
    columns = np.stack([1 / y, x**p / y])
    constant, factor = np.linalg.lstsq(columns.T, np.ones_like(y), rcond=None)[0]
    if constant < 0:
        constant, factor = 0.0, columns[1].sum() / (columns[1] @ columns[1])
    if factor < 0:
        constant, factor = columns[0].sum() / (columns[0] @ columns[0]), 0.0
    errors = constant * columns[0] + factor * columns[1] - 1
    return float(errors @ errors), float(constant), float(factor)


def is_flat(y: Sequence[float]) -> bool:
    """Whether y hardly grows from the first point to the last."""
    return y[-1] < (1 + FLAT) * y[0]


def upper_slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope between the last two points, both logarithmic."""
    return float(np.log(y[-1] / y[-2]) / np.log(x[-1] / x[-2]))


def exponent_range(x: Sequence[float], samples: Sequence[Sequence[float]]) -> tuple[float, float]:
    """What exponents the measurements' noise allows: 5th and 95th percentile of a bootstrap.

    Args:
        x: as in `fit`.
        samples: measurements at each x; medians of as many, drawn anew from them, are fitted.
    """
    rng = np.random.default_rng(0)
    exponents = []
    for _ in range(RESAMPLED):
        drawn = [np.median(rng.choice(measured, len(measured))) for measured in samples]
        exponents.append(fit(x, [float(y) for y in drawn]).exponent)
    low, high = np.percentile(exponents, MIDDLE)
    return float(low), float(high)
