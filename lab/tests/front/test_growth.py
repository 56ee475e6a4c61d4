"""A step's bookkeeping does not see the other views; and how its growth is kept and told."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import pytest
from torch import Tensor

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.separation import layer
from desplat_ns.separation.regions import Comparison
from lab.front.growth import (
    DRAWN,
    OTHERS,
    SERIES,
    STATIC,
    VIEWS,
    Growth,
    Point,
    load,
    measure_series,
    save,
)
from lab.front.growth_plot import draw
from lab.front.growth_report import (
    OnPaper,
    bytes_per,
    memory_table,
    time_table,
)
from lab.front.whole_step import Size, WholeStep


def bytecodes(call: Callable[[], object]) -> int:
    """Python instructions that a call executes."""
    count = 0

    def trace(frame: Any, event: str, argument: object) -> Any:
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    before = sys.gettrace()
    sys._getframe().f_trace_opcodes = True  # Python 3.12 looks for a frame that asks for them
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


@pytest.mark.parametrize("others", [None, 5])
def test_a_step_executes_as_much_python_however_many_views_there_are(others, monkeypatch):
    find_regions = layer.find_regions

    def find_none(comparison: Comparison, config: DistractorConfig, unexplained: Any) -> Tensor:
        return find_regions(comparison, replace(config, weak_excess=inf), unexplained)

    monkeypatch.setattr(layer, "find_regions", find_none)  # what it executes depends on the photo
    counts = []
    for views in (3, 60):
        step = WholeStep(Size(views, 50, 32, 24, 5, others))
        step()
        counts.append(min(bytecodes(step), bytecodes(step)))  # what is cached is made once
    assert abs(counts[1] - counts[0]) < 57  # not one instruction for each view more


def test_a_step_leaves_the_sets_as_they_are_and_says_what_it_trains():
    size = Size(3, 50, 32, 24, 5, 7)
    step = WholeStep(size)
    for _ in range(4):
        step()
    assert step.model.distractors is not None
    assert step.model.distractors.counts() == [5, 7, 7]
    assert step.model.distractors.total == size.all_distractors == 19
    # 59 numbers of a static Gaussian, 14 of a distractor, 4 bytes each, with two moments
    assert step.model.trained_bytes() == 12 * (59 * 50 + 14 * 19)


def made_up(series: str, sizes: tuple[Size, ...], slope: float) -> list[Point]:
    """10 ms and `slope` for one more; 1 MiB and twice the bytes of parameters and moments."""
    points = []
    for size in sizes:
        trained = 12 * (59 * size.static + 14 * size.all_distractors)
        point = Point(series, size, (), trained, 1 + 2 * trained / 2**20)
        points.append(replace(point, cpu_ms=(10 + slope * point.x,) * 3))
    return points


MADE_UP = Growth(
    {"Processor": "a", "Load before the run": "0.1", "Date": "2026-01-01"},
    "b" * 40,
    (
        *made_up(VIEWS, SERIES[VIEWS], 0.0),
        *made_up(STATIC, SERIES[STATIC], 0.01),
        *made_up(OTHERS, SERIES[OTHERS], 0.0),
    ),
)


def test_tables_tell_exponents_and_bytes():
    times, memory = time_table(MADE_UP), memory_table(MADE_UP)
    assert "| 10.0 (10.0 - 10.0) | 10.0 (10.0 - 10.0) | too flat to fit (+0%) | 0.00 |" in times
    assert "| 60.0 (60.0 - 60.0) | 2010 (2010 - 2010) | 1.00 (1.00 - 1.00) |" in times
    assert "| static Gaussians | 708 | 1,416 |" in memory
    assert "| distractors of all views | 168 | 336 |" in memory
    assert DRAWN not in times


def test_what_is_worked_out_is_what_slopes_give():
    paper = OnPaper.of(MADE_UP)
    assert paper.static_bytes == pytest.approx(708)
    assert paper.distractor_bytes == pytest.approx(168)
    assert paper.view_bytes == pytest.approx(200 * 168)  # the other half of the peak
    texts = paper.texts()
    assert texts["static_gigabytes"] == "0.71" and texts["left_megabytes"] == "114"
    assert texts["visits"] == "118" and texts["view_ms"] in ("+0.0", "-0.0")


def test_where_memory_is_not_told_the_tables_say_so():
    blind = tuple(replace(point, peak_mib=None) for point in MADE_UP.points)
    assert bytes_per(blind[:4], measured=True) is None
    assert "| n/a | n/a - n/a | n/a |" in memory_table(replace(MADE_UP, points=blind))


def test_records_come_back_and_are_drawn(tmp_path):
    save(MADE_UP, tmp_path / "growth.json")
    assert load(tmp_path / "growth.json") == MADE_UP
    plots = [tmp_path / name for name in ("growth.svg", "growth.png")]
    draw(MADE_UP, plots)
    first = plots[0].read_bytes()
    draw(MADE_UP, plots)
    assert plots[0].read_bytes() == first and plots[1].stat().st_size > 1000


def test_a_series_is_measured_in_turns(monkeypatch):
    monkeypatch.setattr("lab.front.growth.measure_peak", lambda size, like: 1.0)
    sizes = tuple(Size(n, 200, 64, 48, 20) for n in (2, 3, 5))
    points = measure_series(VIEWS, sizes, rounds=1)
    assert [point.x for point in points] == [2, 3, 5]
    assert all(len(point.cpu_ms) >= 1 and min(point.cpu_ms) > 0 for point in points)
