"""Why a run had its effects: the survey's words, or that there are none."""

import json
from pathlib import Path
from typing import Any

import pytest

from desplat_ns.report.effect_reasons import (
    MAX_NAMES,
    TITLES,
    effect_reasons,
    in_words,
    read_survey,
)
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
    effects = Effects(True, "camera", "off")
    distractors, appearance, background = effect_reasons(effects, SURVEY, 29, ["a.jpg", "b.jpg"])
    assert (distractors.value, appearance.value, background.value) == ("on", "camera", "off")
    assert distractors.why == "In 2 of 29 photos: a.jpg, b.jpg."
    assert appearance.why.startswith("Because.") and "a close call" in appearance.why
    assert [part.is_unsure for part in (distractors, appearance, background)] == [False, True, True]
    assert appearance.figures[0]["value"] is None
    assert appearance.could_not_tell == ["what is before the sky"]


def test_an_effect_that_was_given_against_the_survey_says_so():
    given = Effects(False, "affine", "off")
    distractors, appearance, _ = effect_reasons(given, SURVEY, 29, [])
    assert (distractors.value, distractors.why) == ("off", "As given.")
    assert appearance.value == "affine"
    assert "would have said camera: Because." in appearance.why
    assert not appearance.is_unsure


def test_without_a_survey_that_is_said():
    distractors, *others = reasons = effect_reasons(Effects(), None, 29, ["a.jpg"])
    assert [reason.title for reason in reasons] == list(TITLES.values())
    assert all("no record of a survey" in reason.why for reason in others)
    assert distractors.why == "In 1 of 29 photos: a.jpg."


@pytest.mark.parametrize("survey", [SURVEY, None])
def test_where_nothing_was_found_that_is_said(survey):
    distractors, *_ = effect_reasons(Effects(), survey, 29, [])
    assert (distractors.value, distractors.is_unsure) == ("on", False)
    assert distractors.why == "In none of 29 photos: nothing was found in the way."


def test_of_many_photos_with_something_in_the_way_some_are_named():
    names = [f"{number}.jpg" for number in range(MAX_NAMES + 7)]
    why = effect_reasons(Effects(), None, 2000, names)[0].why
    assert why.startswith("In 37 of 2,000 photos: 0.jpg, 1.jpg, ")
    assert why.endswith("29.jpg and 7 more.")


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
