"""The page in a real browser: sliders move, the scene is drawn, and no request leaves the page."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from desplat_ns.tools.report.page import report_html
from desplat_ns.tools.scene.page import scene_html
from tests.helpers.browser import Page, headless_page
from tests.helpers.report import contents
from tests.helpers.scene import contents as scene_contents

pytestmark = pytest.mark.slow

PHOTO, STATIC = "photo", "static scene"
"""In the made-up run the one is red, the other blue."""

FRAME = "document.querySelector('iframe.scene')"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(report_html(contents()))
    return path.as_uri()


@pytest.fixture(scope="module")
def page(address: str) -> Iterator[Page]:
    with headless_page() as opened:
        opened.open(address)
        yield opened


def box_of(page: Page, element: str) -> tuple[float, float, float, float]:
    """Left, top, width and height of an element in the window, once it is scrolled there."""
    page.value(f"{element}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    rect = page.value(f"{element}.getBoundingClientRect().toJSON()")
    return rect["x"], rect["y"], rect["width"], rect["height"]


def shown(page: Page, number: int, share: float) -> str:
    """Which picture a slider shows at a share of its width."""
    left, top, width, height = box_of(page, f"document.querySelectorAll('.compare')[{number}]")
    red, _, blue = page.picture().getpixel((left + share * width, top + height / 4))  # type: ignore[misc]
    return PHOTO if red > blue else STATIC


def test_a_slider_moves_by_keyboard_and_changes_what_is_shown(page: Page):
    page.value("document.querySelectorAll('.compare input')[0].focus()")
    assert (shown(page, 0, 0.4), shown(page, 0, 0.6)) == (PHOTO, STATIC)
    for _ in range(20):
        page.press("ArrowRight", 39)
    assert page.value("document.activeElement.value") == "70"
    assert page.value("document.activeElement.getAttribute('aria-valuetext')") == "70% photo"
    assert (shown(page, 0, 0.6), shown(page, 0, 0.8)) == (PHOTO, STATIC)


def test_a_command_is_copied_whole(page: Page):
    page.value("addEventListener('copy', () => { globalThis.copied = String(getSelection()) }), 0")
    page.value("document.querySelector('.command button').click()")
    assert page.value("copied").startswith("desplat-export page --load-config ")
    assert page.value("copied").endswith(" --output scene.html")


def test_no_request_leaves_the_page_and_nothing_goes_wrong(page: Page, address: str):
    asked = [request for request in page.requests() if not request.startswith("data:")]
    assert asked == [address]
    wrong = [e for e in page.events if e["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
    assert wrong == []
    broken = "[...document.images].filter(image => !image.naturalWidth).length"
    assert page.value(broken) == 0


def test_the_scene_is_drawn_in_the_report_which_scrolls_on_until_it_is_clicked(tmp_path: Path):
    path = tmp_path / "report.html"
    path.write_text(report_html(contents(), scene=scene_html(scene_contents(), 4_000_000)[0]))
    with headless_page(webgl=True) as page:
        page.open(path.as_uri())
        page.wait_for(f"!!{FRAME}.contentWindow.scenePage")
        left, top, width, height = box_of(page, FRAME)
        page.wait_for(f"{FRAME}.contentWindow.scenePage.settled()")
        corners = (left + 0.3 * width, top + 0.3 * height, left + 0.7 * width, top + 0.7 * height)
        middle = page.picture().crop(tuple(map(int, corners)))  # type: ignore[arg-type]
        assert len(middle.getcolors(100_000) or []) > 1000, "a scene of many colours"
        own = [request for request in page.requests() if not request.startswith(("data:", "blob:"))]
        assert set(own) <= {path.as_uri(), "about:srcdoc"}
        where = {"x": left + 200, "y": top + 200}
        place = f"JSON.stringify({FRAME}.contentWindow.scenePage.camera.position)"
        before, scrolled = page.value(place), page.value("scrollY")
        wheel = {"type": "mouseWheel", "deltaX": 0, "deltaY": -100, **where}
        page.call("Input.dispatchMouseEvent", **wheel)
        page.wait_for(f"scrollY < {scrolled}")
        assert page.value(place) == before, "the report is scrolled past the scene"
        page.drag((where["x"], where["y"]), (where["x"], where["y"]))
        page.wait_for(f"!{FRAME}.contentDocument.body.matches('.framed')")
        before = page.value(place)
        page.call("Input.dispatchMouseEvent", **wheel)
        page.wait_for(f"{place} !== {before!r}")
        wrong = ("Log.entryAdded", "Runtime.exceptionThrown", "Runtime.consoleAPICalled")
        assert [e for e in page.events if e["method"] in wrong] == []
