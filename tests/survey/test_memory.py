"""Every decision that is on needs memory, and only those."""

from __future__ import annotations

from typing import get_args

import pytest

from desplat_ns.settings.effects import AppearanceGrade, BackgroundGrade
from desplat_ns.survey.memory import memory_of

DECISIONS = [("distractors", True), ("distractors", False)]
DECISIONS += [("appearance", grade) for grade in get_args(AppearanceGrade) if grade != "sh"]
DECISIONS += [("background", grade) for grade in get_args(BackgroundGrade)]


@pytest.mark.parametrize(("effect", "decision"), DECISIONS)
def test_what_is_on_needs_memory(effect, decision):
    is_on = decision not in (False, "off")
    assert (memory_of(effect, decision) != "nothing") == is_on
