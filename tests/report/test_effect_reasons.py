"""Why a run had its effects: the survey's words, or that there are none."""

import json
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.report.effect_reasons import TITLES, effect_reasons, in_words, read_survey
from desplat_ns.settings.effects import Effects


def finding(decision: Any, confidence: str = "clear") -> dict[str, Any]:
    figure = {"name": "covered", "value": None, "threshold": 0.004, "meaning": "share of places"}
    return {
        "decision": decision,
        "confidence": confidence,
        "reason": "Because.",
        "figures": [figure],
        "could_not_tell": ["what is before the sky"],
    }


SURVEY = {
    "appearance": finding("camera", "close"),
    "background": finding("off", "none"),
}


def test_an_effect_has_the_surveys_reason_and_figures():
    distractors, appearance, background = effect_reasons(Effects(True, "camera", "off"), SURVEY)
    assert (distractors.value, appearance.value, background.value) == ("on", "camera", "off")
    assert "training finds out" in distractors.why
    assert appearance.why.startswith("Because.") and "a close call" in appearance.why
    assert [part.is_unsure for part in (distractors, appearance, background)] == [False, True, True]
    assert appearance.figures[0]["value"] is None
    assert appearance.could_not_tell == ["what is before the sky"]


def test_an_effect_that_was_given_against_the_survey_says_so():
    given = Effects(False, "affine", "off")
    distractors, appearance, _ = effect_reasons(given, SURVEY)
    assert (distractors.value, distractors.why) == ("off", "As given.")
    assert appearance.value == "affine"
    assert "would have said camera: Because." in appearance.why
    assert not appearance.is_unsure


def test_without_a_survey_that_is_said():
    reasons = effect_reasons(Effects(), None)
    assert [reason.title for reason in reasons] == list(TITLES.values())
    assert all("no record of a survey" in reason.why for reason in reasons)


@pytest.mark.parametrize("content", ["", "[1, 2]", "{}", "{", '{"appearance": {}}'])
def test_findings_that_cannot_be_read_are_none(tmp_path: Path, content: str):
    (tmp_path / "survey.json").write_text(content)
    assert read_survey(tmp_path / "survey.json") is None
    assert read_survey(tmp_path / "gone.json") is None


def test_findings_are_read_as_they_were_written(tmp_path: Path):
    path = tmp_path / "survey.json"
    path.write_text(json.dumps(SURVEY))
    assert read_survey(path) == SURVEY


def test_switches_in_words():
    assert [in_words(value) for value in (True, False, "affine")] == ["on", "off", "affine"]
