"""Shares are Amdahl's, parts are a step's own, and what is watched is put back."""

from __future__ import annotations

import time

import pytest

from desplat_ns.model import DeSplatModel
from lab.front.whole_step import Size, WholeStep
from lab.performance.serial_share import PARTS, REST, Stopwatch, parts_of, share_of, speedup


def test_shares_and_speeds_worked_out_by_hand():
    assert share_of(10.0, 5.0, 2) == 0.0  # halved: nothing is serial
    assert share_of(10.0, 10.0, 2) == 1.0
    assert share_of(10.0, 7.5, 2) == pytest.approx(0.5)  # 5 + 5 / 2
    assert share_of(10.0, 4.0, 4) == pytest.approx(0.2)  # 2 + 8 / 4
    assert share_of(10.0, 12.0, 2) == 1.0 and share_of(10.0, 4.0, 2) == 0.0
    assert speedup(0.5, 2) == pytest.approx(4 / 3)
    assert speedup(0.0, 8) == 8 and speedup(1.0, 8) == 1


@pytest.mark.parametrize("threads", [2, 8])
@pytest.mark.parametrize("share", [0.0, 0.15, 1.0])
def test_a_share_comes_back_from_the_time_that_it_forecasts(share, threads):
    assert share_of(1.0, 1 / speedup(share, threads), threads) == pytest.approx(share)


def test_a_part_has_its_own_time_without_that_of_parts_within(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    watch = Stopwatch()

    def passes(seconds: float) -> None:
        now[0] += seconds

    inner = watch.timed(passes, "inner")

    def body() -> None:
        passes(1.0)
        inner(2.0)
        passes(4.0)

    passes(8.0)
    watch.timed(body, "outer")()
    with pytest.raises(ZeroDivisionError):
        watch.timed(lambda: 1 / 0, "outer")()
    watch.lap()
    assert watch.ms == {REST: 8000.0, "outer": 5000.0, "inner": 2000.0}


def test_all_parts_occur_in_a_step_and_nothing_stays_watched():
    before = vars(DeSplatModel)["get_outputs"]
    times = parts_of(WholeStep(Size(5, 60, 32, 24, 3)))
    assert set(times) == {*PARTS.values(), REST}
    assert all(ms > 0 for ms in times.values())
    assert vars(DeSplatModel)["get_outputs"] is before
