"""What a point costs over the cheapest of its exactness."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.studies.summary import front
from lab.pixels.dial_points import excess

# Few different numbers, so that ties occur.
figure = st.integers(1, 6).map(float) | st.floats(0.1, 10)
clouds = st.lists(st.tuples(figure, figure), max_size=12)


def test_the_excess_of_five_points_is_as_worked_out_by_hand():
    points = [(1.0, 9.0), (2.0, 4.0), (3.0, 5.0), (1.0, 9.5), (8.0, 0.0)]
    assert excess(points) == [1, 1, 1.5, 1, 1]


@given(clouds)
def test_nothing_costs_less_than_the_cheapest_of_its_exactness_and_the_front_no_more(points):
    over = excess(points)
    assert all(x >= 1 for x in over)
    assert all(over[i] == 1 for i in front(points))


def test_what_is_no_number_has_no_excess():
    points = [(math.nan, 0.0), (1.0, math.nan), (2.0, 3.0)]
    assert excess(points) == pytest.approx([math.nan, math.nan, 1], nan_ok=True)
    assert excess([]) == []
