"""A run's length, its rates and its clock; what a budget holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.schedule import (
    END_SECONDS,
    FEWEST_STEPS,
    MOST_RATE_FACTOR,
    STEPS_WANTED,
    BudgetPlan,
    RunStep,
    Schedule,
    early_rate_factor,
    plan_budget,
    rate_factor,
    saved_plan,
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
    assert (
        Schedule(0.1).nominal(RunStep(372)) == 3_720
        and Schedule(0.02).nominal(RunStep(372)) == 18_600
    )
    schedule = Schedule(0.02)
    assert schedule.go_on(RunStep(372), 3_720, 600)
    assert [schedule.nominal(RunStep(step)) for step in (372, 486, 600)] == [3_720, 16_860, 30_000]
    again = Schedule(0.02)
    assert again.go_on(RunStep(486), schedule.nominal(RunStep(486)), 600)
    assert all(
        again.nominal(RunStep(step)) == schedule.nominal(RunStep(step)) for step in range(486, 600)
    )


@pytest.mark.parametrize(("step", "reached", "total"), [(300, 15_000, 600), (600, 30_000, 3_000)])
def test_the_same_total_or_a_larger_one_changes_no_schedule(step: int, reached: int, total: int):
    schedule = Schedule(total / 30_000)
    assert not schedule.go_on(RunStep(step), reached, total)
    assert schedule.nominal(RunStep(step)) == round(step / schedule.scale)


def test_a_longer_run_never_has_higher_rates():
    factors = [rate_factor(100, steps, 100.0) for steps in (1, 100, 1000, 5000, 20_000, 10**6)]
    assert factors == sorted(factors, reverse=True)
    assert factors[0] == MOST_RATE_FACTOR and factors[-1] == rate_factor(100, 1, 0.0) == 1.0


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


# --- a plan --------------------------------------------------------------------------------------


def planned(budget: float, seconds: float, most: int = 30_000, spent: float = 0.0) -> BudgetPlan:
    """A plan where half a photo takes half of the seconds of a whole one."""
    return plan_budget(budget, spent, (seconds, seconds / 2), 1, most)


def test_a_plan_has_the_steps_that_fit_and_smaller_photos_where_too_few_do():
    plan = planned(2000 * 0.1 + 10 + END_SECONDS, 0.1, spent=10.0)
    assert plan.steps == pytest.approx(2000, abs=1) and plan.downscale == 1
    assert planned(1e6, 0.1).steps == 30_000
    half = planned(0.2 * 0.9 * STEPS_WANTED + END_SECONDS, 0.2)
    assert half.downscale == 2 and half.steps == pytest.approx(1.8 * STEPS_WANTED, abs=1)


def test_a_budget_that_holds_no_run_is_refused_with_one_that_does():
    with pytest.raises(ConfigError, match=r"Give (\d+)s or more") as refused:
        planned(0.05 * FEWEST_STEPS * 0.9, 0.1)
    enough = float(str(refused.value).split("Give ")[1].split("s or")[0])
    assert planned(enough, 0.1).steps >= FEWEST_STEPS
    assert planned(20.0, 0.1, most=20).steps == 20  # few are asked for


def test_a_saved_plan_is_gone_on_with_unless_nothing_is_left():
    plan = BudgetPlan(2000, 1, 2500, spent=60.0, reached=900.0)
    state = {"budget": asdict(plan) | {"seconds": (0.1, 0.2)}}  # as earlier versions saved
    assert saved_plan(Path("a.ckpt"), state, 120.0, 5.0) == plan
    for budget, reached in ((60.0, 900.0), (120.0, 2000.0)):
        with pytest.raises(ConfigError):
            saved_plan(Path(), {"budget": asdict(plan) | {"reached": reached}}, budget, 5.0)
    with pytest.raises(ConfigError, match="--budget"):
        saved_plan(Path("a.ckpt"), {}, 120.0, 5.0)


# --- the clock -----------------------------------------------------------------------------------


class Machine:
    """Trains a plan in a budget by a clock of its own, which runs as fast as its steps cost."""

    def __init__(self, start: float, seconds: Callable[[int, float], float]):
        self.now, self.seconds = start, seconds

    def train(self, budget: float, plan: BudgetPlan, first: int = 0) -> int:
        """Steps done when it is over."""
        step, self.now = first, self.now + plan.spent
        while True:
            self.now += self.seconds(step, self.now)
            if plan.after_step(step, self.now, budget, step == first):
                return step + 1
            step += 1


def a_plan(steps: int, most: int = 10**6, **options: float) -> BudgetPlan:
    return BudgetPlan(steps, 1, most, **options)


@pytest.mark.slow
@settings(max_examples=15)
@given(pace=st.floats(0.3, 3), slower=st.floats(0.5, 3), at=st.floats(0.1, 0.9))
def test_schedules_and_time_end_together(pace, slower, at):
    """Also where the machine is faster or slower than measured, and changes on the way: but for
    the last step."""
    budget, steps = 120.0, int((120 - 10) / 0.05)
    longest = 0.05 * pace * max(1.0, slower)
    machine = Machine(10.0, lambda _, now: 0.05 * pace * (slower if now > at * budget else 1))
    plan = a_plan(steps)
    machine.train(budget, plan)
    assert 0 <= machine.now - (budget - END_SECONDS) <= longest + 1e-9
    assert plan.reached == pytest.approx(steps)


@pytest.mark.parametrize(("budget", "most"), [(100.0, 2500), (1000.0, 2000)])
def test_a_run_ends_at_the_most_steps_and_its_schedules_with_it(budget, most):
    machine = Machine(0.0, lambda _, __: 0.01)
    plan = a_plan(2000, most)
    assert machine.train(budget, plan) == most
    assert plan.reached == pytest.approx(2000, abs=1)


def test_a_first_step_that_reads_the_photos_is_taken_for_no_pace():
    """It takes 30 s, the others what is expected of them; also where a run goes on."""
    for first, spent, reached in ((0, 0.0, 0.0), (1000, 60.0, 900.0)):
        machine = Machine(10.0, lambda step, _, first=first: 30.0 if step == first else 0.05)
        plan = a_plan(2000, spent=spent, reached=reached)
        assert Schedule(0.5, plan).nominal(RunStep(first)) == 2 * reached
        steps = machine.train(120.0, plan, first) - first
        assert steps == pytest.approx((120 - END_SECONDS - spent - 40) / 0.05, abs=2)
        assert machine.now == pytest.approx(120 - END_SECONDS, abs=0.06)


@pytest.mark.parametrize("loading", [109.0, 500.0])
def test_a_budget_that_is_up_once_photos_are_read_ends_the_run(loading):
    """What time is left after reading takes the schedules to their end, if any is left at all."""
    machine = Machine(5.0, lambda step, _: loading if step == 0 else 0.05)
    steps = machine.train(120.0, a_plan(2000))
    assert steps == pytest.approx(1 + max(0.0, 120 - END_SECONDS - 5 - loading) / 0.05, abs=1)
