"""The page in a real browser: sliders move what is shown, and no request leaves the page."""

from collections.abc import Iterator

import pytest

from desplat_ns.report.page import html_of
from tests.helpers.browser import Page, headless_page
from tests.helpers.report import contents

pytestmark = pytest.mark.slow

KEYS = {"ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35}
PHOTO, STATIC = "photo", "static scene"
"""In the made-up run the one is red, the other blue."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(html_of(contents()))
    return path.as_uri()


@pytest.fixture(scope="module")
def page(address: str) -> Iterator[Page]:
    with headless_page() as opened:
        opened.open(address)
        yield opened


def box_of(page: Page, number: int) -> tuple[float, float, float, float]:
    """Left, top, width and height of a slider in the window, once it is scrolled there."""
    frame = f"document.querySelectorAll('.compare')[{number}]"
    page.value(f"{frame}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    rect = page.value(f"{frame}.getBoundingClientRect().toJSON()")
    return rect["x"], rect["y"], rect["width"], rect["height"]


def shown(page: Page, number: int, share: float) -> str:
    """Which picture a slider shows at a share of its width."""
    left, top, width, height = box_of(page, number)
    red, _, blue = page.picture().getpixel((left + share * width, top + height / 4))  # type: ignore[misc]
    return PHOTO if red > blue else STATIC


def test_every_slider_moves_by_keyboard_and_changes_what_is_shown(page: Page):
    count = page.value("document.querySelectorAll('.compare input').length")
    assert count == 3
    for number in range(count):
        page.value(f"document.querySelectorAll('.compare input')[{number}].focus()")
        assert (shown(page, number, 0.4), shown(page, number, 0.6)) == (PHOTO, STATIC)
        for _ in range(20):
            page.press("ArrowRight", KEYS["ArrowRight"])
        assert page.value("document.activeElement.value") == "70"
        assert page.value("document.activeElement.getAttribute('aria-valuetext')") == "70% photo"
        assert (shown(page, number, 0.6), shown(page, number, 0.8)) == (PHOTO, STATIC)
        page.press("Home", KEYS["Home"])
        assert shown(page, number, 0.1) == STATIC
        page.press("End", KEYS["End"])
        assert shown(page, number, 0.9) == PHOTO


def test_sliders_are_reached_by_tabs_and_their_focus_is_seen(page: Page):
    page.value("document.querySelectorAll('.compare input')[0].focus()")
    page.press("Tab", 9)
    second = "document.querySelectorAll('.compare input')[1]"
    assert page.value(f"document.activeElement === {second}")
    outline = f"getComputedStyle({second}.closest('.slider')).outlineStyle"
    assert page.value(outline) == "solid"


def test_a_slider_follows_mouse_and_finger(page: Page):
    left, top, width, height = box_of(page, 1)
    middle = top + height / 2
    page.drag((left + 0.5 * width, middle), (left + 0.2 * width, middle))
    assert (shown(page, 1, 0.1), shown(page, 1, 0.3)) == (PHOTO, STATIC)
    page.swipe((left + 0.2 * width, middle), (left + 0.8 * width, middle))
    assert (shown(page, 1, 0.7), shown(page, 1, 0.9)) == (PHOTO, STATIC)


def test_no_request_leaves_the_page_and_nothing_goes_wrong(page: Page, address: str):
    asked = [request for request in page.requests() if not request.startswith("data:")]
    assert asked == [address]
    wrong = [e for e in page.events if e["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
    assert wrong == []
    broken = "[...document.images].filter(image => !image.naturalWidth).length"
    assert page.value(broken) == 0


@pytest.mark.parametrize("width", [360, 390, 768, 1600])
def test_a_page_is_as_wide_as_its_window(page: Page, width: int):
    page.call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=800,
        deviceScaleFactor=1,
        mobile=False,
    )
    assert page.value("document.documentElement.scrollWidth") <= width
    page.call("Emulation.clearDeviceMetricsOverride")
