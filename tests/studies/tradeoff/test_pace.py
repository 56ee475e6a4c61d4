"""A study does what fits into its time, and says when nothing does."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from desplat_ns.studies.grid.runs import Run
from desplat_ns.studies.tradeoff.pace import (
    BESIDE_OTHERS,
    START_SECONDS,
    Clock,
    Pace,
    fitting,
    plan_for,
)
from desplat_ns.studies.tradeoff.plan import BACKEND, BASE, SEEDS

NAMES = (BASE, "fewer")


def run(setting: str = BASE, steps: int = 100, seed: int = 42) -> Run:
    return Run(setting, "capture", 1, steps, seed)


def test_runs_are_expected_to_take_what_steps_took_and_then_what_runs_took():
    pace = Pace(0.1)
    assert pace.seconds(run()) == pytest.approx(START_SECONDS + 100 * 0.1 * BESIDE_OTHERS)
    pace.add(run(), 25.0, 20.0)
    assert pace.seconds(run()) == pytest.approx(5 + 20)
    assert pace.seconds(run(steps=200)) == pytest.approx(5 + 40)
    assert pace.seconds(run("fewer")) == pytest.approx(5 + 20), "as the base until it is known"
    pace.add(run("fewer"), 14.0, 10.0)
    assert pace.seconds(run("fewer")) == pytest.approx(4 + 10)


@given(seconds=st.floats(30, 1e5), jobs=st.integers(1, 8), step=st.floats(1e-3, 1.0))
def test_a_plan_of_all_seeds_fits_its_time(seconds, jobs, step):
    pace = Pace(step)
    try:
        plan = plan_for(seconds, jobs, pace, NAMES, 30_000)
    except ConfigError:
        assert pace.seconds(run(steps=31)) > seconds
        return
    if plan.steps > 500:
        of_comparison = [
            r for r in plan.runs() if r.steps <= 4 * plan.steps and r.setting != BACKEND
        ]
        assert sum(map(pace.seconds, of_comparison)) <= seconds * jobs
        assert {r.seed for r in of_comparison} == set(SEEDS)


def test_few_settings_at_a_telling_length_come_before_all_at_a_short_one():
    names = (BASE, *(f"other{n}" for n in range(20)))
    assert plan_for(900.0, 1, Pace(0.1), names, 30_000).steps == 500
    assert plan_for(300.0, 1, Pace(0.1), names, 30_000).steps < 500


def test_too_little_time_says_how_much_is_needed():
    with pytest.raises(ConfigError, match=r"Give --time \d+min or more"):
        plan_for(10.0, 1, Pace(0.05), NAMES, 30_000)


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
