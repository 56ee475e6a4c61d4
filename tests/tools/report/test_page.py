"""The page: well nested, nothing unescaped, nothing asked from elsewhere, never too large; what is
said of a run, and when nothing is."""

import html
import re
from dataclasses import replace
from typing import Any

import pytest

from desplat_ns.core.pages import Picture
from desplat_ns.tools.report import page
from desplat_ns.tools.report.page import report_html
from tests.helpers.html import Elements
from tests.helpers.report import contents, held_out_photo, noise, plain_photo, training_photo

EVIL = "<script>alert(1)</script>\"'&.png"


def test_a_page_asks_for_nothing():
    text = report_html(contents())
    for tag, attrs, _ in Elements(text).all:
        for name in ("src", "href", "srcset", "data", "action"):
            address = attrs.get(name)
            assert address is None or address.startswith(("data:", "#")), (tag, address)
    assert not re.findall(r"https?://|@import|url\(", text)
    assert "default-src 'none'" in text


def test_names_are_text_whatever_is_in_them():
    evil = contents(
        experiment=EVIL,
        capture=EVIL,
        training=[training_photo(EVIL)],
        held_out=[held_out_photo(EVIL)],
        alone={EVIL: 0.5},
        in_the_way=[EVIL],
        config=EVIL,
    )
    text = report_html(evil)
    assert "<script>alert" not in text
    assert text.count("<script>") == 1
    assert "alert" not in "".join(v for _, attrs, _ in Elements(text).all for v in attrs if v)


def test_a_run_that_scored_nothing_has_a_page():
    plain = [plain_photo("a.jpg")]
    empty = contents(training=plain, alone={}, held_out=[], results={}, num_photos=1700)
    assert len(Elements(report_html(empty)).of("img")) == 2


def test_pictures_stand_with_their_photo():
    photos = [training_photo(f"{n}.jpg") for n in range(4)]
    photos.insert(2, plain_photo("plain.jpg"))
    images = Elements(report_html(contents(training=photos))).of("img")
    by_name = {image["alt"] or "": image["src"] for image, _ in images}
    red, blue = by_name["plain.jpg, the photo"], by_name["plain.jpg, the static scene"]
    assert red != blue
    for n in range(4):
        assert by_name[f"{n}.jpg, the photo"] == red
        assert by_name[f"{n}.jpg, the static scene"] == blue


def test_pictures_get_what_the_scene_leaves_of_the_page(monkeypatch):
    monkeypatch.setattr(page, "SOURCE_BYTES", 1_500_000)
    large = Picture(noise(1, 640, 480))
    loud = [
        replace(plain_photo(name), pictures={"photo": large, "rendering": large}) for name in "abcd"
    ]

    def size(scene: str) -> int:
        text = report_html(contents(training=loud, held_out=[]), scene)
        return sum(map(len, re.findall(r"data:image[^\"]*", text)))

    alone = size("")
    assert alone <= 1_500_000
    assert size("s" * (1_500_001 - alone)) < alone


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
        ({"alone": {"a.jpg": 0.5}}, ["a.jpg (50%)."]),
        ({"alone": dict.fromkeys("abcd", 0.5)}, ["a (50%), b (50%), c (50%) and 1 more."]),
    ],
)
def test_what_stands_out_is_said_with_what_to_try(changes: dict[str, Any], words: list[str]):
    (text,) = said(**changes)
    assert all(word in text for word in words), text


@pytest.mark.parametrize("changes", [{}, {"distractors": None, "training": covered(0.0)}])
def test_where_nothing_stands_out_nothing_is_said(changes: dict[str, Any]):
    assert said(**changes) == []
