from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.studies.summary import CostAndError, front

# Few different numbers, so that ties occur.
figure = st.integers(1, 6).map(float) | st.floats(0.1, 10)
clouds = st.lists(st.tuples(figure, figure), max_size=12)


def dominates(a: CostAndError, b: CostAndError) -> bool:
    return a[0] <= b[0] and a[1] <= b[1] and a != b


def test_the_front_of_five_points_is_as_worked_out_by_hand():
    """The third is dearer and worse than the second, the fourth as dear as the first and worse."""
    assert front([(1.0, 9.0), (2.0, 4.0), (3.0, 5.0), (1.0, 9.5), (8.0, 0.0)]) == {0, 1, 4}


@given(clouds)
def test_no_point_of_the_front_is_dominated_and_every_other_is(points):
    best = front(points)
    for i, point in enumerate(points):
        assert (i in best) == (not any(dominates(other, point) for other in points))


def test_equal_points_share_their_fate():
    assert front([(1.0, 1.0), (1.0, 1.0), (2.0, 2.0), (2.0, 2.0)]) == {0, 1}


def test_what_is_no_number_is_on_no_front_and_hides_nothing():
    assert front([(math.nan, 0.0), (1.0, math.nan), (2.0, 3.0)]) == {2}


def test_no_points_have_no_front():
    assert front([]) == set()
