"""The time that is left is told by what is done, in lines where no bar can be drawn."""

from itertools import count
from types import SimpleNamespace

import pytest

from desplat_ns.core import console
from desplat_ns.core.console import progress_over, progress_with_time_left, seconds_left


def test_the_time_left_follows_the_pace_and_not_a_slow_start():
    assert seconds_left([(0.0, 0)], 10) is None
    assert seconds_left([(0.0, 0), (2.0, 1)], 10) == 18.0
    slow_start = [(0.0, 0), (30.0, 1), (31.0, 2), (32.0, 3)]
    assert seconds_left(slow_start, 10) == 7.0


def test_what_was_done_before_sets_no_pace():
    assert seconds_left([(0.0, 90), (2.0, 91)], 100) == 18.0


@pytest.fixture
def lines(monkeypatch):
    """What is announced while a clock goes on by ten seconds with each look at it."""
    said, clock = list[str](), count(0, 10)
    monkeypatch.setattr(console, "announce", said.append)
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    return said


def test_where_no_bar_can_be_drawn_a_line_a_minute_tells_the_time(lines):
    with progress_over(20, "Rendering...") as advance:
        for _ in range(20):
            advance()
    assert [line.split(":")[0] for line in lines] == ["Rendering"] * 4
    assert "about 3 min" in lines[0] and "about 10 s" in lines[-1]


def test_of_parts_that_differ_no_time_is_told(lines):
    with progress_with_time_left("Mapping", alike=False) as show:
        for done in range(20):
            show(done, 20)
    assert not lines
