"""The page: well nested, nothing unescaped, nothing asked from elsewhere, never too large."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from desplat_ns.report.history import History
from desplat_ns.report.page import html_of, typed
from tests.helpers.report import COST, contents, held_out_photo, noise, training_photo

VOID = {"meta", "link", "img", "input", "br"}
EVIL = "<script>alert(1)</script>\"'&.png"


class Tags(HTMLParser):
    """Raises AssertionError where tags do not nest; counts them and collects their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def tags_of(html: str) -> list[tuple[str, dict[str, str | None]]]:
    parser = Tags()
    parser.feed(html)
    assert parser.open == []
    return parser.tags


def test_every_training_photo_has_a_slider_with_a_label_and_its_pictures():
    tags = tags_of(html_of(contents()))
    sliders = [attrs for tag, attrs in tags if tag == "input"]
    assert [slider["type"] for slider in sliders] == ["range"] * 3
    assert all((slider["aria-label"] or "").startswith("photo_") for slider in sliders)
    images = [attrs for tag, attrs in tags if tag == "img"]
    assert len(images) == 3 * 4 + 3
    assert all(image["alt"] for image in images)


def test_it_says_which_views_can_be_trusted_if_that_is_known():
    figures = {"psnr": 25.0, "angle": 6.6}
    held_out = [held_out_photo("extra.png", figures=figures)]
    html = html_of(contents(held_out=held_out))
    assert "<p>extra.png is 7° from the photos.</p>" in html
    assert "PSNR 25.00 dB, 7° from the photos" in html
    assert "from the photos" not in html_of(contents(trusted=""))


def test_a_page_asks_for_nothing():
    html = html_of(contents())
    for tag, attrs in tags_of(html):
        for name in ("src", "href", "srcset", "data", "action"):
            address = attrs.get(name)
            assert address is None or address.startswith(("data:", "#")), (tag, address)
    assert not re.findall(r"https?://|@import|url\(", html)
    assert "default-src 'none'" in html


def test_names_are_text_whatever_is_in_them():
    evil = contents(
        cost=replace(COST, experiment=EVIL, capture=EVIL, trained_on=EVIL),
        training=[training_photo(EVIL)],
        held_out=[held_out_photo(EVIL)],
        machine={EVIL: EVIL},
        config=EVIL,
    )
    html = html_of(evil)
    assert "<script>alert" not in html
    assert html.count("<script>") == 1
    assert "alert" not in "".join(v for _, attrs in tags_of(html) for v in attrs if v)


def test_options_are_set_as_what_is_typed_and_the_rest_is_escaped():
    assert typed("Try --a.b-c 2 <now>.") == "Try <code>--a.b-c</code> 2 &lt;now&gt;."


@pytest.mark.slow
def test_fifty_large_photos_stay_below_ten_megabytes():
    """Noise, which compresses worst; what a page gets of photos of any size is 1024 pixels."""
    large = [noise(seed, 640, 480) for seed in range(2)]
    changes = {"photo": large[0], "static": large[1], "distractors": large[0], "mask": large[1]}
    photos = [training_photo(f"{n}.jpg", size=(6000, 4000), **changes) for n in range(3)]
    budget = 3 * 9_000_000 // 50
    html = html_of(contents(training=photos, held_out=[]), budget)
    assert len(html) < budget + 100_000
    assert re.search(
        r"reduced to \d+ pixels on the longer side, where the photos\s+have 6,000", html
    )


def test_a_choice_of_many_photos_is_told():
    results = {"num_images": 40, "protocol": "full image"}
    html = html_of(contents(cost=replace(COST, num_photos=1700), results=results))
    assert "3 of 1,700 photos are shown, evenly chosen" in html
    assert "The worst 1 of 40 are shown" in html


def test_what_there_is_not_is_told():
    plain = training_photo("a.jpg", distractors=None, mask=None, covered=None)
    empty = contents(
        training=[plain],
        notices=[],
        held_out=[],
        results={},
        history=History((), None),
        cost=replace(COST, seconds=None),
    )
    html = html_of(empty)
    for words in ("there is no TensorBoard file", "None were evaluated", "Nothing: the run is"):
        assert words in html
    assert "not recorded" in html
    assert "their mask" not in html
    tags_of(html)


def photos_covered(*shares: float | None) -> str:
    """A page of training photos of which so much is covered."""
    photos = [training_photo(f"{n}.jpg", covered=share) for n, share in enumerate(shares)]
    return html_of(contents(training=photos))


def test_photos_that_are_covered_most_come_first_and_those_that_are_not_are_folded():
    html = photos_covered(0.0, 0.1, 0.3, 0.0)
    tags_of(html)
    assert re.findall(r"<h3>(\d)\.jpg", html) == ["2", "1", "0", "3"]
    folded = html[html.index("2 photos with nothing in the way") :]
    assert re.findall(r"<h3>(\d)\.jpg", folded[: folded.index("</details>")]) == ["0", "3"]


@pytest.mark.parametrize("share", [0.0, None, 0.2])
def test_where_all_photos_are_alike_none_is_folded(share):
    html = photos_covered(share, share)
    assert re.findall(r"<h3>(\d)\.jpg", html) == ["0", "1"]
    assert "with nothing in the way" not in html


@pytest.mark.parametrize("number", [0, 1, 5])
def test_pictures_stand_with_their_photo(number: int):
    photos = [training_photo(f"{n}.jpg") for n in range(number)]
    photos.insert(number // 2, training_photo("plain.jpg", distractors=None, mask=None))
    images = [attrs for tag, attrs in tags_of(html_of(contents(training=photos))) if tag == "img"]
    by_name = {(image["alt"] or ""): image["src"] for image in images}
    red, blue = by_name["plain.jpg, the photo"], by_name["plain.jpg, the static scene"]
    assert red != blue
    for n in range(number):
        assert by_name[f"{n}.jpg, the photo"] == red
        assert by_name[f"{n}.jpg, the static scene"] == blue
        assert (
            by_name[f"{n}.jpg, its distractors"] == by_name[f"{n}.jpg, the mask of its distractors"]
        )
