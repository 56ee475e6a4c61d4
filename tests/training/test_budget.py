"""Schedules that go by time end when the time is up, whatever the machine does."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from desplat_ns.training.budget import (
    END_SECONDS,
    BudgetClock,
    BudgetState,
    Clock,
    StepSeconds,
    seconds_of,
)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("10min", 600), ("90s", 90), ("90", 90), ("1h30min", 5400), ("1.5h", 5400), ("2m 5s", 125)],
)
def test_times_are_read_with_their_units(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize(
    "text", ["", "0", "-3s", "soon", "1..2s", "10 parsecs", "5s1h", "nan", "1h30", "2m 5"]
)
def test_what_is_no_time_is_refused_with_an_example(text):
    with pytest.raises(ConfigError, match="such as 10min"):
        seconds_of(text)


def test_the_cost_of_pixels_is_what_halving_a_photo_saves():
    cost = StepSeconds.through(whole=0.10, half=0.04)  # 0.02 + 0.08 / d^2
    assert cost.fixed == pytest.approx(0.02)
    assert cost.of_pixels(1) == pytest.approx(0.08)
    assert cost.of_pixels(4) == pytest.approx(0.005)


def test_small_photos_that_cost_more_by_chance_give_no_negative_cost():
    cost = StepSeconds.through(whole=0.05, half=0.06)
    assert (cost.fixed, cost.whole_photo) == (0.05, 0.0)


class Machine:
    """A clock that runs as fast as its steps cost."""

    def __init__(self, start: float, seconds: Callable[[int, float], float]):
        self.now, self.seconds = start, seconds

    def seconds_gone(self) -> float:
        return self.now

    def train(self, clock: BudgetClock, first: int = 0) -> int:
        """Steps done when the clock says that it is over."""
        step = first
        while True:
            self.now += self.seconds(step, self.now)
            clock.after_step(step)
            step += 1
            if clock.is_over(step):
                return step


def clock_on(machine: Machine, budget: float, steps: int, most: int = 10**6) -> BudgetClock:
    """One whose planned steps are expected to take a twentieth of a second each."""
    state = BudgetState(steps, 1, most)
    return BudgetClock(budget, state, [0.05] * steps, machine.seconds_gone)


def test_a_run_of_given_length_goes_by_its_steps():
    assert [Clock().nominal(step) for step in (0, 1, 29_999)] == [0, 1, 29_999]
    assert [Clock(1 / 30).nominal(step) for step in (0, 1, 999)] == [0, 30, 29_970]
    assert [Clock(0.75).nominal(step) for step in range(4)] == [0, 1, 3, 4]


@given(steps=st.integers(1, 30_000), step=st.integers(0, 30_000))
def test_no_two_steps_of_a_run_are_the_same_nominal_one(steps, step):
    clock = Clock(steps / 30_000)
    assert clock.nominal(step + 1) > clock.nominal(step)
    assert clock.nominal(steps) == 30_000


def test_a_run_by_time_goes_by_nominal_steps_as_well():
    clock = BudgetClock(100.0, BudgetState(600, 1, 600), [0.1] * 600, lambda: 0.0, scale=0.02)
    clock.state.reached = 299.7
    assert clock.at(7) == 299.7
    assert clock.nominal(7) == 14_985


@pytest.mark.slow
@given(pace=st.floats(0.3, 3), slower=st.floats(0.5, 3), at=st.floats(0.1, 0.9))
def test_schedules_and_time_end_together(pace, slower, at):
    """Also where the machine is faster or slower than measured, and changes on the way: but for
    the last step, or half a planned one."""
    budget, planned = 120.0, int((120 - 10) / 0.05)
    a_planned = (budget - END_SECONDS - 10) / (planned - 1)
    longest = 0.05 * pace * max(1.0, slower)
    machine = Machine(10.0, lambda _, now: 0.05 * pace * (slower if now > at * budget else 1))
    clock = clock_on(machine, budget, planned)
    machine.train(clock)
    assert abs(machine.now - (budget - END_SECONDS)) <= max(longest, 0.5 * a_planned) + 1e-9
    assert clock.state.steps - clock.state.reached < 0.5 or clock.left() <= 0


def test_a_machine_half_as_fast_for_a_minute_in_the_middle_ends_in_time_with_its_schedules():
    budget = 240.0
    machine = Machine(0.0, lambda _, now: 0.1 if 90 <= now < 150 else 0.05)
    clock = clock_on(machine, budget, steps=int((budget - END_SECONDS) / 0.05))
    steps = machine.train(clock)
    assert abs(machine.now - (budget - END_SECONDS)) <= 0.05 + 1e-9
    assert clock.state.reached == pytest.approx(clock.state.steps, abs=0.5)
    assert abs(clock.state.steps - 600 - steps) <= 2  # a minute of steps that took twice as long


@given(steps=st.integers(2, 400), small=st.floats(0.01, 1), at=st.floats(0, 1))
def test_a_machine_as_expected_goes_through_the_plan_step_by_step(steps, small, at):
    """Also where steps differ in what they cost."""
    costs = [(small if step < at * steps else 1.0) for step in range(steps)]
    machine = Machine(0.0, lambda step, _: costs[min(step, steps - 1)])
    clock = BudgetClock(
        sum(costs) + END_SECONDS, BudgetState(steps, 1, 10**6), costs, machine.seconds_gone
    )
    for step in range(steps):
        assert clock.at(step) == pytest.approx(step, abs=1e-6)
        machine.now += costs[step]
        clock.after_step(step)
        assert clock.at(step) == pytest.approx(step, abs=1e-6)  # until the next one begins
        assert clock.is_over(step + 1) == (step + 1 == steps)


def test_a_run_ends_at_the_most_steps_and_its_schedules_with_it():
    machine = Machine(0.0, lambda _, __: 0.01)
    clock = clock_on(machine, 100.0, steps=2000, most=2500)
    assert machine.train(clock) == 2500
    assert clock.state.reached == pytest.approx(2000, abs=1)


def test_where_only_the_most_steps_end_a_run_its_schedules_go_by_steps():
    machine = Machine(0.0, lambda _, __: 0.01)
    clock = clock_on(machine, 1000.0, steps=2000, most=2000)
    for step in range(2000):
        assert clock.at(step) == pytest.approx(step, abs=1e-6)
        clock.after_step(step)
    assert clock.is_over(2000)


def test_a_first_step_that_reads_the_photos_is_taken_for_no_pace():
    """It took 30 s; the others take what was expected of them."""
    machine = Machine(10.0, lambda step, _: 30.0 if step == 0 else 0.05)
    clock = clock_on(machine, budget=120.0, steps=int(110 / 0.05))
    steps = machine.train(clock)
    assert steps == pytest.approx((120 - END_SECONDS - 40) / 0.05, abs=2)
    assert abs(machine.now - (120 - END_SECONDS)) <= 0.05 + 1e-9


def test_a_resumed_run_counts_what_was_spent_and_goes_on_where_its_schedules_were():
    machine = Machine(20.0, lambda step, _: 15.0 if step == 1000 else 0.05)
    state = BudgetState(2000, 1, 10**6, spent=60.0, reached=900.0)
    clock = BudgetClock(120.0, state, [0.05] * 2000, machine.seconds_gone)
    assert clock.at(1000) == 900
    steps = machine.train(clock, first=1000)
    assert steps - 1000 == pytest.approx((120 - END_SECONDS - 95) / 0.05, abs=2)
    assert state.spent == pytest.approx(clock.spent())
    assert state.reached == pytest.approx(2000, abs=0.5)
    assert BudgetState(**state.saved()) == state


@pytest.mark.parametrize("loading", [109.0, 500.0])
def test_a_budget_that_is_up_before_the_schedules_warm_up_ends_the_run(loading):
    """What time is left after reading takes the schedules to their end, if any is left at all."""
    machine = Machine(5.0, lambda step, _: loading if step == 0 else 0.05)
    clock = clock_on(machine, budget=120.0, steps=2000)
    steps = machine.train(clock)
    left = max(0.0, 120 - END_SECONDS - 5 - loading)
    assert steps == pytest.approx(1 + left / 0.05, abs=1)
    assert machine.now <= max(120, 5 + loading)
