"""The curves of a run: thinned, and what was done twice counts once."""

import math
from pathlib import Path

import pytest

from desplat_ns.report import history
from desplat_ns.report.event_files import Scalar
from desplat_ns.report.history import TOTAL_TIME, read_history, thinned


def test_few_points_stay_as_they_are():
    assert thinned({2: 5.0, 1: 4.0}) == ((1.0, 4.0), (2.0, 5.0))


def test_of_many_points_neighbours_are_averaged():
    assert thinned({step: 2.0 * step for step in range(4)}, most=2) == ((0.5, 1.0), (2.5, 5.0))
    assert len(thinned({step: 1.0 for step in range(30_000)})) <= history.MOST_POINTS


def test_what_cannot_be_drawn_is_left_out():
    values = {0: math.nan, 1: math.inf, 2: 0.0, 3: 1.0}
    assert thinned(values) == ((2.0, 0.0), (3.0, 1.0))
    assert thinned(values, is_logarithmic=True) == ((3.0, 1.0),)


def test_a_run_that_went_on_has_one_curve_and_the_time_of_both_sittings(monkeypatch):
    first = [Scalar("Train Loss", step, 1.0, 10.0 + step) for step in range(6)]
    second = [Scalar("Train Loss", step, 2.0, 90.0) for step in range(4, 8)]
    second += [Scalar(TOTAL_TIME, 8, 30.0, 95.0)]
    files = {"1": first, "2": second}
    monkeypatch.setattr(history, "scalars", lambda path, tags: iter(files[path.name]))
    found = read_history([Path("1"), Path("2")])
    (chart,) = found.charts
    assert [value for _, value in chart.curves[0].points] == [1.0] * 4 + [2.0] * 4
    assert found.seconds == pytest.approx(5.0 + 30.0)


def test_a_run_that_logged_nothing_has_no_curves(tmp_path: Path):
    assert read_history([]).charts == ()
    assert read_history([tmp_path / "gone"]).seconds is None
