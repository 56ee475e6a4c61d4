"""Which photos are shown, and what an error map shows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.report.pictures import ERROR_COLORS, ERROR_TOP, error_map
from desplat_ns.runs.loading import even_subset
from tests.helpers.report import flat, noise


@given(count=st.integers(0, 2000), most=st.integers(0, 60))
def test_a_subset_is_even_and_has_both_ends(count: int, most: int):
    chosen = even_subset(count, most)
    assert len(chosen) == min(count, most)
    assert chosen == sorted(set(chosen))
    if len(chosen) > 1:
        assert (chosen[0], chosen[-1]) == (0, count - 1)
        steps = np.diff(chosen)
        assert steps.max() - steps.min() <= 1


def test_equal_pictures_have_no_error_and_large_errors_the_brightest_colour():
    photo = flat((100, 100, 100))
    assert (error_map(photo, photo) == ERROR_COLORS[0]).all()
    assert (error_map(photo, flat((0, 0, 0))) == ERROR_COLORS[-1]).all()


def test_half_of_the_largest_error_has_the_colour_in_the_middle():
    off = round(255 * ERROR_TOP / 2)
    colour = error_map(flat((0, 0, 0)), flat((off, off, off)))[0, 0]
    assert colour.tolist() == pytest.approx(ERROR_COLORS[2], abs=2)


def test_the_sign_of_an_error_means_nothing():
    photo, other = noise(0), noise(1)
    assert (error_map(photo, other) == error_map(other, photo)).all()
