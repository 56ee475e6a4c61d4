"""Every decision has a cost, and only what is off has none."""

from __future__ import annotations

from typing import get_args

import pytest

from desplat_ns.effects import AppearanceGrade, BackgroundGrade
from desplat_ns.survey.costs import MEMORY, STEP_RATIOS, cost_of

DECISIONS = [("distractors", True), ("distractors", False)]
DECISIONS += [("appearance", grade) for grade in get_args(AppearanceGrade) if grade != "sh"]
DECISIONS += [("background", grade) for grade in get_args(BackgroundGrade)]


@pytest.mark.parametrize(("effect", "decision"), DECISIONS)
def test_what_is_on_costs_something(effect, decision):
    is_on = decision not in (False, "off")
    assert ((effect, decision) in STEP_RATIOS) == ((effect, decision) in MEMORY) == is_on
    assert ("times as long" in cost_of(effect, decision)) == is_on
