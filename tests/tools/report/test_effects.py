"""What is read back of a run: effects with their reasons."""

import json
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.core.effects import Effects
from desplat_ns.tools.report.page import effect_reasons, read_survey


def finding(decision: Any, confidence: str) -> dict[str, Any]:
    return {"decision": decision, "confidence": confidence, "reason": "Because."}


SURVEY = {"appearance": finding("camera", "close"), "background": finding("off", "none")}


def test_an_effect_has_the_surveys_reason():
    effects = Effects(True, "camera", "off")
    distractors, appearance, background = effect_reasons(effects, SURVEY, 29, ["a.jpg", "b.jpg"])
    assert (distractors[1], appearance[1], background[1]) == ("on", "camera", "off")
    assert "2 of 29" in distractors[2] and "a.jpg, b.jpg" in distractors[2]
    assert appearance[2].startswith("Because.") and "close call" in appearance[2]
    assert "safe side" in background[2]


def test_an_effect_that_was_given_against_the_survey_says_so():
    distractors, appearance, _ = effect_reasons(Effects(False, "affine"), SURVEY, 29, [])
    assert (distractors[1], appearance[1]) == ("off", "affine")
    assert "would have said camera: Because." in appearance[2]


@pytest.mark.parametrize("content", ["", "{"])
def test_findings_that_cannot_be_read_are_none(tmp_path: Path, content: str):
    path = tmp_path / "survey.json"
    path.write_text(content)
    assert read_survey(path) is None
    assert read_survey(tmp_path / "gone.json") is None
    path.write_text(json.dumps(SURVEY))
    assert read_survey(path) == SURVEY
