"""A headless Chromium, driven through its DevTools protocol."""

import base64
import io
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

VARIABLE = "DESPLAT_NS_BROWSER"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--remote-debugging-port=0",
)
WITHOUT_WEBGL = ("--disable-gpu", "--disable-3d-apis")
SOFTWARE_WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE = 60.0
"""Seconds for the browser to start, or to answer."""


def find_browser() -> str:
    """A Chromium that can be started; skips the test, with the reason, where there is none."""
    named = os.environ.get(VARIABLE)
    program = named or next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: install chromium, or set {VARIABLE} to a Chromium's program")
    return program


class Page:
    """A page of a browser."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._last = 0
        self.events: list[dict[str, Any]] = []
        """What the browser told, in order."""

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a method of the DevTools protocol."""
        self._last += 1
        message = {"id": self._last, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == self._last:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def open(self, address: str) -> None:
        """Go there and wait until it is loaded."""
        self.call("Page.navigate", url=address)
        is_there = f"location.href === {json.dumps(address)}"
        self.wait_for(f"{is_there} && document.readyState === 'complete'")

    def value(self, expression: str) -> Any:
        """What a JavaScript expression gives."""
        reply = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in reply, reply
        return reply["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Wait until a JavaScript expression is true."""
        until = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < until, f"{expression} does not become true"
            time.sleep(0.05)

    def resize(self, width: int, height: int) -> None:
        """Give the window a size in CSS's pixels, one on the screen for each."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def press(self, key: str, code: int) -> None:
        """Press a key, as a user does."""
        options = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        self.call("Input.dispatchKeyEvent", type="rawKeyDown", **options)
        self.call("Input.dispatchKeyEvent", type="keyUp", **options)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse at a place of the window, move it, let go."""
        moves = (("mousePressed", start, 1), ("mouseMoved", end, 1), ("mouseReleased", end, 0))
        for kind, (x, y), held in moves:
            where = {"x": x, "y": y, "button": "left", "buttons": held, "clickCount": 1}
            self.call("Input.dispatchMouseEvent", type=kind, **where)

    def swipe(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Put a finger on a place of the window, move it, lift it."""
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        moves = [("touchStart", [start]), ("touchMove", [middle]), ("touchMove", [end])]
        for kind, places in [*moves, ("touchEnd", [])]:
            points = [{"x": x, "y": y} for x, y in places]
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def picture(self) -> Image.Image:
        """What is in the window, one pixel for each of CSS's."""
        reply = self.call("Page.captureScreenshot", format="png")
        return Image.open(io.BytesIO(base64.b64decode(reply["data"]))).convert("RGB")

    def requests(self) -> list[str]:
        """Addresses that were asked for so far, by whatever is on the page."""
        self.value("0")  # what was told before is heard then
        return [
            event["params"]["request"]["url"]
            for event in self.events
            if event["method"] == "Network.requestWillBeSent"
        ]


@contextmanager
def headless_page(webgl: bool = False) -> Iterator[Page]:
    """An empty page in a browser of its own, which is ended afterwards.

    Args:
        webgl: drawn on the CPU, whatever the machine has.
    """
    program = find_browser()
    client = pytest.importorskip("websockets.sync.client")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [
                program,
                *ARGUMENTS,
                *(SOFTWARE_WEBGL if webgl else WITHOUT_WEBGL),
                f"--user-data-dir={profile}",
                "--window-size=1000,800",
                "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            with client.connect(_address(Path(profile), process), max_size=None) as socket:
                page = Page(socket)
                for domain in ("Page", "Network", "Runtime", "Log"):
                    page.call(f"{domain}.enable")
                yield page
        finally:
            process.terminate()
            process.wait(timeout=PATIENCE)


def _address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """Of the page's DevTools socket, once the browser is up."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until and process.poll() is None:
        with_port = profile / "DevToolsActivePort"
        if with_port.exists() and (lines := with_port.read_text().splitlines()):
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                pages = [page for page in json.load(answer) if page["type"] == "page"]
            if pages:
                return pages[0]["webSocketDebuggerUrl"]
        time.sleep(0.1)
    pytest.skip(f"the browser did not start (exit status {process.poll()})")
