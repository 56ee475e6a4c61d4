"""A scene's page in a browser that draws on the CPU."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.helpers.browser import Page, headless_page

BARE = "<style id=bare>header, footer, #hint { display: none !important }</style>"
"""The stage alone, so that it is as large as the window."""


def opened(page: Page, path: Path) -> None:
    """Open a scene's page, and wait until it shows the scene or says why not."""
    page.open(path.as_uri())
    page.wait_for("!!globalThis.scenePage || document.body.classList.contains('failed')")


def bare(page: Page) -> None:
    """Show the stage alone."""
    page.value(f"document.head.insertAdjacentHTML('beforeend', '{BARE}')")


def settle(page: Page, action: str = "") -> None:
    """Do something on the page, and wait until what follows is drawn."""
    page.value(f"{action}; scenePage.redraw()")
    page.wait_for("scenePage.settled()")


def shown(page: Page) -> np.ndarray:
    """What is in the window [H, W, 3], in [0, 1]."""
    return np.asarray(page.picture()) / 255


@contextmanager
def bare_scene(path: Path, text: str, width: int, height: int) -> Iterator[Page]:
    """The stage of a page alone, of this size."""
    path.write_text(text)
    with headless_page(webgl=True) as page:
        page.resize(width, height)
        opened(page, path)
        bare(page)
        yield page
