"""Made-up measurements give the exponent that they were made with."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.front.power_law import exponent_range, fit, is_flat, upper_slope

X = [8, 100, 400, 1700]


@given(constant=st.floats(0, 100), factor=st.floats(0.1, 10), hundredths=st.integers(30, 200))
def test_the_exponent_is_found_whatever_the_constant(constant, factor, hundredths):
    y = [constant + factor * x ** (hundredths / 100) for x in X]
    law = fit(X, y)
    assert law.exponent == pytest.approx(hundredths / 100, abs=0.011)
    assert [law.at(x) for x in X] == pytest.approx(y, rel=0.02)


def test_values_worked_out_by_hand():
    law = fit([1, 2, 4, 8], [3 + 2 * x for x in (1, 2, 4, 8)])
    assert (law.constant, law.factor, law.exponent) == pytest.approx((3, 2, 1), rel=1e-6)


def test_no_step_takes_less_than_no_time():
    x = [1.0, 2.0, 4.0, 8.0]
    law = fit(x, [0.5, 2.0, 6.0, 14.0])  # 2 x - 2, bent down at the start
    assert law.constant >= 0 and law.factor >= 0
    falling = fit(x, [4.0, 3.0, 2.0, 1.0])
    assert falling.factor == 0 and falling.at(1) == falling.at(8)


def test_two_points_settle_nothing():
    with pytest.raises(ValueError, match="2 points"):
        fit([1, 2, 2], [1, 2, 2])


def test_what_hardly_grows_is_flat():
    assert is_flat([10.0, 13.0, 12.4])
    assert not is_flat([10.0, 12.6])


def test_the_upper_slope_is_that_of_the_last_two_points():
    assert upper_slope([1, 10, 100], [5.0, 7.0, 70.0]) == pytest.approx(1)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_range_holds_the_exponent_and_widens_with_noise(noise):
    rng = np.random.default_rng(1)
    samples = [list((5 + 0.1 * x) * (1 + noise * rng.standard_normal(20))) for x in X]
    low, high = exponent_range(X, samples)
    assert low - 0.011 <= 1.0 <= high + 0.011
    assert (high - low > 0.01) == (noise > 0)
