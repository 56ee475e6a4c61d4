"""The page: well nested, nothing unescaped, nothing asked from elsewhere, never too large."""

import re
from dataclasses import replace
from html.parser import HTMLParser

from desplat_ns.tools.pages import Picture
from desplat_ns.tools.report import page
from desplat_ns.tools.report.page import report_html
from tests.helpers.report import contents, held_out_photo, noise, plain_photo, training_photo

VOID = {"meta", "link", "img", "input", "br"}
EVIL = "<script>alert(1)</script>\"'&.png"


class Tags(HTMLParser):
    """Raises AssertionError where tags do not nest; collects them with their attributes."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def of(self, name: str) -> list[dict[str, str | None]]:
        return [attrs for tag, attrs in self.tags if tag == name]


def test_a_page_asks_for_nothing():
    html = report_html(contents())
    for tag, attrs in Tags(html).tags:
        for name in ("src", "href", "srcset", "data", "action"):
            address = attrs.get(name)
            assert address is None or address.startswith(("data:", "#")), (tag, address)
    assert not re.findall(r"https?://|@import|url\(", html)
    assert "default-src 'none'" in html


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
    html = report_html(evil)
    assert "<script>alert" not in html
    assert html.count("<script>") == 1
    assert "alert" not in "".join(v for _, attrs in Tags(html).tags for v in attrs if v)


def test_a_run_that_scored_nothing_has_a_page():
    plain = [plain_photo("a.jpg")]
    empty = contents(training=plain, alone={}, held_out=[], results={}, num_photos=1700)
    assert len(Tags(report_html(empty)).of("img")) == 2


def photos_covered(*shares: float) -> str:
    """A page of training photos of which these shares are covered."""
    photos = [training_photo(f"{n}.jpg", share) for n, share in enumerate(shares)]
    return report_html(contents(training=photos))


def test_photos_that_are_covered_most_come_first_and_those_that_are_not_are_folded():
    html = photos_covered(0.0, 0.1, 0.3, 0.0)
    assert re.findall(r"<h3>(\d)\.jpg", html) == ["2", "1", "0", "3"]
    folded = html[html.index('<h2 id="training"') :].partition("<details>")[2]
    assert re.findall(r"<h3>(\d)\.jpg", folded.partition("</details>")[0]) == ["0", "3"]


def test_pictures_stand_with_their_photo():
    photos = [training_photo(f"{n}.jpg") for n in range(4)]
    photos.insert(2, plain_photo("plain.jpg"))
    images = Tags(report_html(contents(training=photos))).of("img")
    by_name = {(image["alt"] or ""): image["src"] for image in images}
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
