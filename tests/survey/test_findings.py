from __future__ import annotations

import math
from typing import get_args

import pytest

from desplat_ns.settings.effects import AppearanceGrade, BackgroundGrade
from desplat_ns.survey.findings import CLEAR, Figure, Finding, confidence_of

DECISIONS = [("distractors", True), ("distractors", False)]
DECISIONS += [("appearance", grade) for grade in get_args(AppearanceGrade) if grade != "sh"]
DECISIONS += [("background", grade) for grade in get_args(BackgroundGrade)]


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


@pytest.mark.parametrize(("effect", "decision"), DECISIONS)
def test_what_is_on_needs_memory_and_only_that(effect, decision):
    finding = Finding(effect, decision, "clear", "", ())
    assert (finding.memory != "nothing") == (decision not in (False, "off"))
