"""A run's length, its rates and its clock; what a budget holds."""

import pytest

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.schedule import (
    MOST_RATE_FACTOR,
    RunStep,
    Schedule,
    early_rate_factor,
    rate_factor,
    seconds_of,
    steps_for_visits,
)


def test_visits_make_steps_up_to_the_methods_own_number():
    assert steps_for_visits(25.0, 40, 30_000) == 1_000
    assert steps_for_visits(0.51, 50, 30_000) == 26
    assert steps_for_visits(150.0, 1_700, 30_000) == 30_000
    assert steps_for_visits(25.0, 8, 30_000) == steps_for_visits(25.0, 0, 30_000) == 1_000
    assert steps_for_visits(0.001, 8, 30_000) == 1


def test_a_run_that_is_cut_short_does_what_is_ahead_in_the_steps_that_are_left():
    """Stopped at 372 of 3,000 steps and gone on with to 600, of 30,000 nominal ones."""
    assert Schedule(0.1).nominal(RunStep(372)) == 3_720
    assert Schedule(0.02).nominal(RunStep(372)) == 18_600
    schedule = Schedule(0.02)
    assert schedule.go_on(RunStep(372), 3_720, 600)
    assert [schedule.nominal(RunStep(step)) for step in (372, 486, 600)] == [3_720, 16_860, 30_000]
    again = Schedule(0.02)
    assert again.go_on(RunStep(486), schedule.nominal(RunStep(486)), 600)
    for step in map(RunStep, range(486, 600)):
        assert again.nominal(step) == schedule.nominal(step)


def test_a_run_that_has_reached_the_end_of_its_schedules_may_have_steps_left():
    """As one whose machine gets faster at the end of a budget."""
    schedule = Schedule()
    schedule.aim(RunStep(90), 100, 200, end=100.0)
    assert [schedule.nominal(RunStep(step)) for step in (90, 100, 200)] == [100, 100, 101]


def test_a_longer_run_never_has_higher_rates():
    factors = [rate_factor(100, steps, 100.0) for steps in (1, 100, 1000, 5000, 20_000, 10**6)]
    assert factors == sorted(factors, reverse=True)
    assert factors[0] == MOST_RATE_FACTOR and factors[-1] == rate_factor(100, 1, 0.0) == 1.0
    assert rate_factor(8, 1000, 150.0) == pytest.approx(1.2)  # few photos are seen often


def test_rates_are_as_much_higher_as_the_warm_up_is_shorter_until_it_would_have_ended():
    at = {0: 2.5, 120: 2.5, 150: 2.0, 299: 300 / 299, 300: 1.0, 3_000: 1.0}
    assert {step: early_rate_factor(step, 120, 300) for step in at} == at
    assert early_rate_factor(0, 10, 300) == MOST_RATE_FACTOR
    assert early_rate_factor(0, 300, 300) == early_rate_factor(0, 0, 0) == 1.0


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("10min", 600), ("90", 90), ("1h30min", 5400), ("1.5h", 5400), ("2m 5s", 125)],
)
def test_times_are_read_with_their_units(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "0", "-3s", "soon", "1..2s", "5s1h", "nan", "1h30"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(ConfigError, match="--budget"):
        seconds_of(text)
