"""What is said of a run, and when nothing is."""

import html
from typing import Any

import numpy as np
import pytest

from desplat_ns.tools.report.page import report_html
from desplat_ns.tools.report.views import Disputed
from tests.helpers.report import contents, training_photo

DISPUTED = Disputed(0.3, ["photo_1.png", "photo_2.png"], np.ones((4, 6), bool))


def said(**changes: Any) -> list[str]:
    """What is said of a run in which nothing stands out, but for the changes."""
    text = report_html(contents(**{"alone": {}, **changes}))
    items = text.partition('<ul class="notices">')[2].partition("</ul>")[0].split("<li>")[1:]
    return [html.unescape(item) for item in items]


def covered(*shares: float) -> list[Any]:
    return [training_photo(f"{i}.png", share) for i, share in enumerate(shares)]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"verdict": [("Blurred.", "Train on.")]}, ["Blurred.", "Train on."]),
        ({"training": covered(0.7, 0.1, 0.1)}, ["1 of 3", "0.png", "strong-excess (now"]),
        ({"training": covered(0.7, 0.9, 0.1)}, ["2 of 3", "1.png, 0.png", "affine", "lambda-d"]),
        ({"training": covered(0.0, 0.0)}, ["strong-excess"]),
        ({"disputed": DISPUTED}, ["30%", "photo_1.png, photo_2.png", "<img"]),
        ({"alone": {"a.jpg": 0.5}}, ["a.jpg (50%)."]),
        ({"alone": dict.fromkeys("abcd", 0.5)}, ["a (50%), b (50%), c (50%) and 1 more."]),
    ],
)
def test_what_stands_out_is_said_with_what_to_try(changes: dict[str, Any], words: list[str]):
    (text,) = said(**changes)
    assert all(word in text for word in words), text


@pytest.mark.parametrize(
    "changes",
    [{}, {"distractors": None, "training": covered(0.0)}],
)
def test_where_nothing_stands_out_nothing_is_said(changes: dict[str, Any]):
    assert said(**changes) == []
