from __future__ import annotations

import time

import numba
import pytest
import torch

from desplat_ns.calibration import timing
from desplat_ns.calibration.timing import Timing, all_cores, threads, time_in_turns


@pytest.mark.slow
def test_cases_take_turns():
    calls: list[str] = []
    cases = {name: (lambda name=name: calls.append(name)) for name in "ab"}
    timings = time_in_turns(cases, rounds=2)
    turn = ["a"] * (1 + timing.REPEATS) + ["b"] * (1 + timing.REPEATS)
    assert calls == ["a", "a", "b", "b", *turn, *turn]
    assert len(timings["a"].cpu) == len(timings["a"].wall) == 2 * timing.REPEATS


@pytest.mark.slow
def test_slow_cases_run_once_a_turn(monkeypatch):
    monkeypatch.setattr(timing, "SLOW", 0.01)
    calls = []

    def slow():
        calls.append(1)
        time.sleep(0.02)

    timed = time_in_turns({"slow": slow}, rounds=2)["slow"]
    assert len(calls) == 2 + 2 and len(timed.cpu) == 2


@pytest.mark.slow
def test_sleep_costs_wall_time_and_no_processor_time():
    timed = time_in_turns({"sleep": lambda: time.sleep(0.02)}, rounds=1)["sleep"]
    assert timed.wall_ms >= 20
    assert timed.cpu_ms < 10


def test_times_are_medians():
    timed = Timing(cpu=[3.0, 1.0, 2.0], wall=[5.0, 4.0, 9.0])
    assert (timed.cpu_ms, timed.wall_ms) == (2.0, 5.0)


def test_threads_are_set_and_put_back_even_after_an_error():
    before = torch.get_num_threads(), numba.get_num_threads()
    with pytest.raises(KeyError), threads(all_cores()):
        assert torch.get_num_threads() == all_cores()
        raise KeyError
    assert (torch.get_num_threads(), numba.get_num_threads()) == before
