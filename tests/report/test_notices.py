"""What is said of a run, and when nothing is."""

from dataclasses import replace
from typing import Any

import pytest

from desplat_ns.report.effect_reasons import EffectReason
from desplat_ns.report.failure_case import Failure
from desplat_ns.report.notices import notices
from tests.helpers.report import COST, training_photo

LONG = replace(COST, steps=30_000, planned=30_000, num_photos=20)
PHOTOS = [training_photo(f"{number}.png") for number in range(3)]


def said(**changes: Any) -> list[str]:
    """What is said of a long run in which nothing stands out, but for the changes."""
    results = {"psnr": 28.0, "images": []}
    inputs = {"cost": LONG, "reasons": [], "photos": PHOTOS, "results": results}
    inputs |= {"failure": None, "judges_by_others": False, "alone": []}
    return [f"{notice.what} {notice.advice}" for notice in notices(**inputs | changes)]


def test_nothing_is_said_of_a_run_in_which_nothing_stands_out():
    assert said() == []


def scores(*psnrs: float) -> dict[str, Any]:
    images = [{"name": f"extra_{i}.png", "psnr": v} for i, v in enumerate(psnrs)]
    return {"psnr": 28.0, "images": images}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cost": replace(LONG, steps=12_000)}, ["12,000 of 30,000 steps", "--load-dir"]),
        ({"cost": replace(LONG, num_photos=4), "judges_by_others": True}, ["4 training photos"]),
        ({"cost": replace(COST, num_photos=40)}, ["seen 50 times", "After 6,000"]),
        ({"cost": replace(COST, num_photos=8)}, ["seen 250 times", "After 6,000"]),
        ({"photos": [training_photo("a.jpg", covered=0.7)]}, ["half of a.jpg", "strong-excess"]),
        ({"photos": [training_photo("a.jpg", covered=0.0)]}, ["next to nothing", "strong-excess"]),
        ({"results": scores(30.0, 29.0, 20.0)}, ["(29.0 dB): extra_2.png.", "error maps"]),
        ({"results": {"psnr": 20.0}}, ["at 30.0 dB, held-out photos at 20.0 dB", "More photos"]),
        (
            {"failure": Failure("Nobody can tell.", "Leave some out.")},
            ["Nobody can tell. Leave some out."],
        ),
        (
            {"reasons": [EffectReason("appearance", "Light", "camera", "why", True)]},
            ["about appearance (camera)", "--pipeline.model.effects.appearance"],
        ),
    ],
)
def test_what_stands_out_is_said_with_what_to_try(changes: dict[str, Any], words: list[str]):
    (text,) = said(**changes)
    assert all(word in text for word in words), text


def test_few_photos_mean_nothing_where_distractors_start_everywhere():
    assert said(cost=replace(LONG, num_photos=4)) == []


def test_without_distractors_or_an_evaluation_nothing_is_said_of_them():
    plain = training_photo("a.jpg", covered=None, mask=None, distractors=None)
    assert said(photos=[plain], results={}) == []


def test_two_photos_are_too_few_for_one_to_be_far_off():
    assert said(results=scores(30.0, 20.0)) == []
