from __future__ import annotations

import time

from desplat_ns.calibration.timing import REPEATS
from lab.pixels import budgeted_turns
from lab.pixels.budgeted_turns import (
    FAST_ROUNDS,
    MOST_SLOW_TURNS,
    MOST_TURNS,
    Budget,
    Case,
    due_seconds,
    take_turns,
)
from lab.pixels.dial_errors import DialErrors
from lab.pixels.dial_points import Label

ERRORS = DialErrors(0.1, 20.0, 0.2, "means")


def case_of(seconds: float, clock: str = "CPU") -> Case:
    """One that does nothing and is said to take so long."""
    labels = [Label("a", "dial", "value", "numba"), Label("b", "dial", "off", "numba")]
    nothing = lambda: None  # noqa: E731
    return Case(labels, True, clock, [ERRORS, ERRORS], (nothing, nothing), seconds)


def spent(seconds: float, of: float) -> Budget:
    return Budget(of, since=time.perf_counter() - seconds)


def test_what_does_not_fit_beside_the_turns_of_others_is_told_why():
    assert spent(10.0, of=60.0).unavailable_reason(expected=15.0, due=0.0) is None
    reason = spent(10.0, of=60.0).unavailable_reason(expected=15.0, due=20.0)
    assert reason == "a call takes about 15.0 s; 30.0 of 60 s are free"
    assert spent(61.0, of=60.0).unavailable_reason(0.0, 0.0) == "no time was left of 60 s"


def test_with_time_every_case_has_all_its_turns(monkeypatch):
    monkeypatch.setattr(budgeted_turns, "SLOW_PAIR", 0.01)
    fast, slow = case_of(1e-3), case_of(0.02)
    slow.calls = (lambda: None, lambda: time.sleep(0.02))
    take_turns([fast, slow], Budget(60.0))
    assert (fast.turns, slow.turns) == (MOST_TURNS, MOST_SLOW_TURNS)
    assert len(slow.both.cpu) == MOST_SLOW_TURNS
    assert due_seconds([fast, slow]) == 0


def test_no_case_has_so_many_turns_that_another_has_none():
    """The slow case is said to take longer than there is: the fast one waits until it is through
    after its own first turn."""
    order: list[str] = []
    fast, slow = case_of(1e-3), case_of(100.0)
    fast.calls = (lambda: order.append("fast"), lambda: None)
    slow.calls = (lambda: order.append("slow"), lambda: None)
    assert due_seconds([fast, slow]) > 100
    take_turns([fast, slow], Budget(60.0))
    assert order.index("slow") == 1 + REPEATS
    assert order.count("fast") > 1 + REPEATS


def test_with_time_fast_cases_have_rounds_of_their_own_first():
    order: list[str] = []
    fast, slow = case_of(1e-3), case_of(2.0)
    fast.calls = (lambda: order.append("fast"), lambda: None)
    slow.calls = (lambda: order.append("slow"), lambda: None)
    take_turns([slow, fast], Budget(60.0))
    assert order.index("slow") >= FAST_ROUNDS * (1 + REPEATS)


def test_when_the_time_is_over_nothing_is_called():
    case = case_of(1e-3)
    take_turns([case], spent(2.0, of=1.0))
    assert case.turns == 0


def test_a_case_makes_a_point_for_each_of_its_labels():
    case = case_of(1e-3)
    case.forward.cpu[:], case.forward.wall[:] = [1.0, 2.0, 9.0], [7.0, 7.0, 7.0]
    case.both.cpu[:], case.both.wall[:] = [4.0, 5.0, 6.0], [8.0, 8.0, 8.0]
    first, second = case.points()
    assert (first.group, second.group) == ("a", "b")
    assert (first.forward_ms, first.both_ms, first.calls) == (2.0, 5.0, 3)
    assert first.forward_range_ms == (1.0, 9.0)
    case.clock = "wall"
    assert case.points()[0].both_ms == 8.0
