"""A study does what fits into its time, and says when nothing does."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from desplat_ns.studies.pace import (
    BESIDE_OTHERS,
    START_SECONDS,
    Clock,
    Pace,
    fitted,
    fitting,
    plan_for,
)
from desplat_ns.studies.plan import BACKEND, BASE, SEEDS, compared
from desplat_ns.studies.runs import Run, Variant
from tests.helpers.tradeoff import CAPTURE

NAMES = (BASE, "fewer")


def run(name: str = BASE, steps: int = 100, seed: int = 42) -> Run:
    return Run(Variant(name), steps, seed, Path("/photos"))


def test_runs_are_expected_to_take_what_steps_took_and_then_what_runs_took():
    pace = Pace(0.1)
    assert pace.seconds(run()) == pytest.approx(START_SECONDS + 100 * 0.1 * BESIDE_OTHERS)
    pace.add(run(), 2 * (START_SECONDS + 100 * 0.1 * BESIDE_OTHERS))
    assert pace.seconds(run(steps=200)) == pytest.approx(2 * (START_SECONDS + 200 * 0.125))
    pace.add(run(steps=300), 80.0)
    pace.add(run(), 65.0 - 2.5)
    assert pace.seconds(run(steps=400)) == pytest.approx(63.75 + 3 / 2 * (80 - 63.75))
    assert pace.seconds(run("fewer")) == pytest.approx(63.75), "as the base until it is known"
    pace.add(run("fewer"), 63.75 / 2)
    assert pace.seconds(run("fewer", 300)) == pytest.approx(80 / 2), "then in proportion"


def test_what_every_run_takes_makes_no_step_of_a_long_one_dearer():
    """Imports, reading photos and the last checkpoint take 40 s of each run here."""
    pace = Pace(0.1)
    for steps in (125, 250):
        pace.add(run(steps=steps), 40 + 0.1 * steps)
    assert pace.seconds(run(steps=8000)) == pytest.approx(840)


@given(
    start=st.floats(0, 1e3),
    step=st.floats(0, 10),
    lengths=st.lists(st.integers(1, 30_000), min_size=2, max_size=6, unique=True),
)
def test_the_line_of_exact_timings_is_found(start, step, lengths):
    """Both sums of the regression are of some ten numbers below 3e5; halves of 1e-6 are left."""
    line = fitted([(steps, start + step * steps) for steps in lengths])
    longest = max(lengths)
    expected = start + step * longest
    assert line[0] + line[1] * longest == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_neither_a_step_nor_a_start_takes_less_than_nothing():
    assert fitted([(100, 30.0), (200, 20.0)]) == (25.0, 0.0)
    assert fitted([(100, 10.0), (200, 30.0)]) == (0.0, pytest.approx(7000 / 50_000))


@pytest.mark.slow
@given(seconds=st.floats(30, 1e5), jobs=st.integers(1, 8), step=st.floats(1e-3, 1.0))
def test_a_plan_of_all_seeds_fits_its_time(seconds, jobs, step):
    pace = Pace(step)
    try:
        plan = plan_for(seconds, jobs, pace, CAPTURE, NAMES, 30_000)
    except ConfigError:
        assert pace.seconds(run(steps=31)) > seconds
        return
    if plan.steps > 500:
        of_comparison = [
            r for r in plan.runs(CAPTURE) if r.steps <= 4 * plan.steps and r.variant.name != BACKEND
        ]
        assert sum(map(pace.seconds, of_comparison)) <= seconds * jobs
        assert {r.seed for r in of_comparison} == set(SEEDS)


def test_few_settings_at_a_telling_length_come_before_all_at_a_short_one():
    names = tuple(compared(CAPTURE.effects))
    assert plan_for(900.0, 1, Pace(0.1), CAPTURE, names, 30_000).steps == 500
    assert plan_for(300.0, 1, Pace(0.1), CAPTURE, names, 30_000).steps < 500


def test_too_little_time_says_how_much_is_needed():
    with pytest.raises(ConfigError, match=r"Give --time \d+min or more"):
        plan_for(10.0, 1, Pace(0.05), CAPTURE, NAMES, 30_000)


def test_runs_that_do_not_fit_are_passed_over_and_asked_for_late():
    pace, clock = Pace(1.0), Clock(300.0)
    runs = [run(steps=100), run(steps=1000), run(steps=200)]
    coming = fitting(runs, {run(steps=100)}, pace, clock)
    clock.earlier = 10.0
    assert next(coming) == run(steps=200)
    assert next(coming, None) is None
    again = fitting(runs, set(), pace, clock)
    assert next(again) == run(steps=100)
    clock.earlier = 290.0
    assert next(again, None) is None, "the time is looked at when a run is asked for"


def test_a_clock_counts_earlier_sittings():
    clock = Clock(100.0, 40.0)
    assert 40.0 <= clock.spent < 41.0 and 59.0 < clock.left <= 60.0
