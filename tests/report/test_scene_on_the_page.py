"""The scene on top of a report, in a real browser: it is drawn there, asks for nothing, and
lets the report scroll."""

from pathlib import Path

import pytest

from desplat_ns.report.page import html_of
from desplat_ns.scene.page import html_of as scene_page
from tests.helpers.browser import headless_page
from tests.helpers.report import contents
from tests.helpers.scene import contents as scene_contents

pytestmark = pytest.mark.slow

FRAME = "document.querySelector('iframe.scene')"


def test_the_scene_is_drawn_in_the_report_which_scrolls_on_until_it_is_clicked(tmp_path: Path):
    path = tmp_path / "report.html"
    path.write_text(html_of(contents(), scene=scene_page(scene_contents(), 4_000_000)[0]))
    with headless_page(webgl=True) as page:
        page.open(path.as_uri())
        page.wait_for(f"!!{FRAME}.contentWindow.scenePage")
        page.value(f"{FRAME}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        page.wait_for(f"{FRAME}.contentWindow.scenePage.settled()")
        box = page.value(f"{FRAME}.getBoundingClientRect().toJSON()")
        middle = page.picture().crop(
            (
                int(box["left"] + 0.3 * box["width"]),
                int(box["top"] + 0.3 * box["height"]),
                int(box["left"] + 0.7 * box["width"]),
                int(box["top"] + 0.7 * box["height"]),
            )
        )
        assert len(middle.getcolors(100_000) or []) > 1000, "a scene of many colours"
        own = [request for request in page.requests() if not request.startswith(("data:", "blob:"))]
        assert set(own) <= {path.as_uri(), "about:srcdoc"}
        where = {"x": box["left"] + 200, "y": box["top"] + 200}
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
