from __future__ import annotations

import math

from desplat_ns.survey.findings import CLEAR, Figure, Finding, confidence_of


def figure(value: float, threshold: float | None = 1.0) -> Figure:
    return Figure("one", value, "a figure", threshold)


def test_a_figure_is_above_its_threshold_only_if_it_is_known():
    assert figure(1.1).is_above
    assert not figure(0.9).is_above
    assert not figure(math.nan).is_above
    assert not figure(5.0, None).is_above


def test_confidence_is_that_of_the_figure_nearest_to_its_threshold():
    assert confidence_of([figure(CLEAR * 1.01), figure(0.0)]) == "clear"
    assert confidence_of([figure(1.1), figure(100.0)]) == "close"
    assert confidence_of([figure(1 / (CLEAR * 1.01))]) == "clear"
    assert confidence_of([figure(math.nan)]) == "none"


def test_a_finding_is_one_line_and_has_its_figures_where_they_are_asked_for():
    finding = Finding("appearance", "camera", "close", "Because.", (figure(1.1),), ("the rest",))
    assert finding.lines() == ["appearance: camera (a close call). Because."]
    assert [line.strip() for line in finding.lines(verbose=True)[1:]] == [
        "one 1.1 (calls for it above 1): a figure",
        "Not told: the rest",
    ]
