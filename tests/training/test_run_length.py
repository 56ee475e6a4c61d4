"""A run's length scales its steps."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from desplat_ns.training.run_length import (
    MOST_RATE_FACTOR,
    early_rate_factor,
    rate_factor,
    schedule_scale,
    steps_for_visits,
)


def test_the_scale_is_the_ratio_of_steps_and_never_above_one():
    assert schedule_scale(3000, 30000) == 0.1
    assert schedule_scale(30000, 30000) == 1.0
    assert schedule_scale(60000, 30000) == 1.0
    assert schedule_scale(1000, 200000) == 0.005


@pytest.mark.parametrize(("steps", "nominal"), [(0, 30000), (-1, 30000), (100, 0)])
def test_a_run_without_steps_is_refused(steps, nominal):
    with pytest.raises(ConfigError, match="--max-num-iterations"):
        schedule_scale(steps, nominal)


def test_rates_are_raised_where_photos_are_seen_seldom_and_nowhere_else():
    assert rate_factor(40, 1_000, 100.0) == 4.0
    assert rate_factor(40, 2_000, 100.0) == 2.0
    assert rate_factor(40, 4_000, 100.0) == rate_factor(40, 30_000, 100.0) == 1.0
    assert rate_factor(40, 10, 100.0) == MOST_RATE_FACTOR
    assert rate_factor(40, 10, 0.0) == 1.0
    assert rate_factor(8, 1_000, 100.0) == 4.0  # few photos take as many steps as 40
    assert rate_factor(80, 4_000, 100.0) == 2.0


def test_rates_are_as_much_higher_as_the_warm_up_is_shorter_until_it_would_have_ended():
    at = {0: 2.5, 120: 2.5, 150: 2.0, 299: 300 / 299, 300: 1.0, 3_000: 1.0}
    assert {step: early_rate_factor(step, 120, 300) for step in at} == at
    assert early_rate_factor(0, 10, 300) == MOST_RATE_FACTOR
    assert early_rate_factor(0, 300, 300) == early_rate_factor(0, 0, 0) == 1.0


@given(views=st.integers(0, 5_000), steps=st.integers(1, 10**6), more=st.integers(0, 10**6))
def test_a_longer_run_never_has_higher_rates(views, steps, more):
    short, long = (rate_factor(views, n, 100.0) for n in (steps, steps + more))
    assert 1.0 <= long <= short <= MOST_RATE_FACTOR


def test_visits_make_steps_up_to_the_methods_own_number():
    assert steps_for_visits(25.0, 40, 30_000) == 1_000
    assert steps_for_visits(0.51, 50, 30_000) == 26
    assert steps_for_visits(150.0, 1_700, 30_000) == 30_000
    assert steps_for_visits(25.0, 8, 30_000) == steps_for_visits(25.0, 0, 30_000) == 1_000
    assert steps_for_visits(0.001, 8, 30_000) == 1
