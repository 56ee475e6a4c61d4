"""What is said of a run, and when nothing is."""

from typing import Any

import numpy as np
import pytest

from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.tools.report.notices import notices
from desplat_ns.tools.report.views import Disputed
from tests.helpers.report import training_photo

PHOTOS = [training_photo(f"{number}.png") for number in range(3)]
DISPUTED = Disputed(0.3, ["1.png", "2.png"], np.ones((4, 6), bool))


def said(**changes: Any) -> list[str]:
    """What is said of a long run in which nothing stands out, but for the changes."""
    inputs = {"steps": 30_000, "planned": 30_000, "photos": PHOTOS, "disputed": None, "alone": {}}
    inputs |= {"distractors": DistractorConfig(start="residual")}
    return [f"{notice.what} {notice.advice}" for notice in notices(**inputs | changes)]


def covered(*shares: float) -> list[Any]:
    return [training_photo(f"{i}.png", share) for i, share in enumerate(shares)]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steps": 12_000}, ["12,000 of 30,000", "--load-dir"]),
        ({"photos": covered(0.7, 0.1, 0.1)}, ["1 of 3", "0.png", "strong-excess"]),
        ({"photos": covered(0.7, 0.9, 0.1)}, ["2 of 3", "1.png, 0.png", "appearance", "lambda-d"]),
        ({"photos": covered(0.0, 0.0)}, ["strong-excess"]),
        ({"disputed": DISPUTED}, ["30%", "1.png, 2.png"]),
        ({"alone": {"a.jpg": 0.5}}, ["a.jpg (50%)"]),
    ],
)
def test_what_stands_out_is_said_with_what_to_try(changes: dict[str, Any], words: list[str]):
    (text,) = said(**changes)
    assert all(word in text for word in words), text


def test_a_disputed_place_is_shown_in_the_photo_that_is_named_first():
    (notice,) = notices(30_000, 30_000, PHOTOS, None, DISPUTED, {})
    assert notice.picture is not None
    assert notice.picture.pixels.shape == PHOTOS[1].pictures["photo"].pixels.shape


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"distractors": None, "photos": covered(0.0)},
        {"steps": 12_000, "planned": None},
    ],
)
def test_where_nothing_stands_out_nothing_is_said(changes: dict[str, Any]):
    assert said(**changes) == []
