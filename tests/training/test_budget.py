"""A plan that is corrected on the way ends when its time is up, whatever the machine does."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.errors import ConfigError
from desplat_ns.training.budget import (
    END_SECONDS,
    BudgetKeeper,
    BudgetState,
    StepSeconds,
    Stretch,
    seconds_of,
)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("10min", 600), ("90s", 90), ("90", 90), ("1h30min", 5400), ("1.5h", 5400), ("2m 5s", 125)],
)
def test_times_are_read_with_their_units(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "0", "-3s", "soon", "1..2s", "10 parsecs", "5s1h", "nan"])
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


@given(st.integers(0, 1000), st.floats(0.2, 5), st.integers(0, 3000))
def test_a_stretch_moves_what_is_ahead_and_finds_the_way_back(at, factor, planned):
    stretch = Stretch(at, factor)
    moved = stretch.moved(planned)
    assert moved == planned if planned <= at else moved > at
    assert abs(stretch.planned(moved) - planned) <= max(1.0, 1 / factor)


def test_several_stretches_are_undone_from_the_last_to_the_first():
    state = BudgetState(steps=150, first_steps=200, downscale=1)
    state.stretches = [Stretch(100, 0.5), Stretch(120, 2.0)]
    assert state.planned(90) == 90
    assert state.planned(120) == 140
    assert state.planned(130) == 150
    assert BudgetState.from_saved(state.saved()) == state


class Machine:
    """A clock that runs as fast as its steps cost."""

    def __init__(self, start: float, seconds: Callable[[int, float], float]):
        self.now, self.seconds = start, seconds

    def clock(self) -> float:
        return self.now

    def train(self, keeper: BudgetKeeper, first: int = 0) -> int:
        """Steps done when the keeper says that it is over."""
        step = first
        while True:
            self.now += self.seconds(step, self.now)
            keeper.after_step(step)
            step += 1
            if keeper.is_over(step):
                return step


def keeper_on(machine: Machine, budget: float, steps: int, most: int = 10**6) -> BudgetKeeper:
    state = BudgetState(steps, steps, 1)
    return BudgetKeeper(budget, state, lambda _: 0.05, most, machine.clock)


@given(pace=st.floats(0.3, 3), slower=st.floats(0.5, 3), at=st.floats(0.1, 0.9))
def test_a_run_ends_within_ten_percent_of_its_budget(pace, slower, at):
    """Also where the machine is faster or slower than measured, and changes on the way."""
    budget = 120.0
    machine = Machine(10.0, lambda _, now: 0.05 * pace * (slower if now > at * budget else 1))
    keeper = keeper_on(machine, budget, steps=int((budget - 10) / 0.05))
    steps = machine.train(keeper)
    assert 0.9 * budget <= machine.now <= budget
    assert steps <= keeper.state.steps


@given(slower=st.floats(1.2, 3))
def test_schedules_come_to_their_end_although_the_machine_is_slower_than_measured(slower):
    """Steps are not just cut off at the deadline."""
    machine = Machine(0.0, lambda _, __: 0.05 * slower)
    keeper = keeper_on(machine, 120.0, steps=2000)
    steps = machine.train(keeper)
    assert keeper.state.planned(steps) == pytest.approx(2000, rel=0.05)


def test_a_machine_as_expected_is_not_corrected():
    machine = Machine(0.0, lambda _, __: 0.05)
    keeper = keeper_on(machine, 100 + END_SECONDS, steps=2000)
    assert machine.train(keeper) == 2000
    assert keeper.state.stretches == []


def test_a_run_is_not_lengthened_beyond_the_most_steps():
    machine = Machine(0.0, lambda _, __: 0.01)
    keeper = keeper_on(machine, 100.0, steps=2000, most=2500)
    assert machine.train(keeper) == 2500


def test_a_first_step_that_reads_the_photos_is_taken_for_no_pace():
    """It took 30 s; the others take what was expected of them."""
    machine = Machine(10.0, lambda step, _: 30.0 if step == 0 else 0.05)
    keeper = keeper_on(machine, budget=120.0, steps=int(110 / 0.05))
    steps = machine.train(keeper)
    assert steps == pytest.approx((120 - END_SECONDS - 40) / 0.05, rel=0.05)
    assert 0.97 * 120 <= machine.now <= 120


def test_a_resumed_run_counts_what_was_spent():
    machine = Machine(20.0, lambda _, __: 0.05)
    state = BudgetState(2000, 2000, 1, spent=60.0)
    keeper = BudgetKeeper(120.0, state, lambda _: 0.05, 10**6, machine.clock)
    steps = machine.train(keeper, first=1000)
    assert steps - 1000 == pytest.approx((120 - END_SECONDS - 80) / 0.05, rel=0.05)
    assert state.spent == pytest.approx(keeper.spent())
