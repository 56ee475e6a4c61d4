"""The HTML page of a scene: one file that needs no other and asks for none."""

from __future__ import annotations

import base64
from pathlib import Path

from desplat_ns.export.coordinates import moved
from desplat_ns.export.spz import fitting, spz_bytes
from desplat_ns.files.encoding import Picture, fitted_into
from desplat_ns.files.pages import template
from desplat_ns.scene.contents import TO_PAGE, Contents
from desplat_ns.scene.reduction import Fitted, fitted

HERE = Path(__file__).parent
TEMPLATE = HERE / "page.html.jinja"
SCRIPT = HERE / "scene.js"
STYLE = HERE / "scene.css"
VIEWER = HERE / "viewer" / "viewer.js.gz"
WASM = HERE / "viewer" / "spark.wasm.gz"

PICTURES_SHARE, PICTURES_MOST = 0.4, 9_000_000
"""Of the page's bytes that pictures may take, and bytes that they take at most."""

BASE64 = 3 / 4
"""Bytes that a character of the page holds."""


def html_of(contents: Contents, most: int) -> tuple[str, list[str]]:
    """The page, and lines about what is not on it.

    Args:
        most: bytes of the page.

    Raises:
        ConfigError: photos or Gaussians do not fit, however few or small.
    """
    pictures = [Picture(one.photo) for one in contents.cameras]
    pictures += [Picture(picture) for _, picture in contents.pictures]
    encoded = fitted_into(pictures, int(min(PICTURES_SHARE * most, PICTURES_MOST)))
    sources = iter(encoded.sources)
    cameras = []
    for index, camera in enumerate(contents.cameras):
        shown = {"index": index, "photo": next(sources), "distractors": ""}
        cameras.append({**camera.as_json(), **shown})
        if camera.distractors is not None:
            near = fitting(moved(camera.distractors, TO_PAGE))[0]
            cameras[-1]["distractors"] = _text(spz_bytes(near))
    renderings = [(name, next(sources)) for name, _ in contents.pictures]
    cloud, left_out = fitting(contents.cloud)

    def page(scene: Fitted | None) -> str:
        return template(TEMPLATE).render(
            page=contents,
            scene="" if scene is None else _text(scene.content),
            kept=0 if scene is None else scene.kept,
            reduced="" if scene is None else _reduced(scene, len(cloud)),
            cameras=cameras,
            data={"cameras": cameras, "background": contents.background}
            | {"antialiased": cloud.antialiased},
            renderings=renderings,
            script=SCRIPT.read_text("utf8"),
            style=STYLE.read_text("utf8"),
            viewer=_text(VIEWER.read_bytes()),
            wasm=_text(WASM.read_bytes()),
        )

    room = most - len(page(None).encode()) - 1_000
    scene = fitted(moved(cloud, TO_PAGE), int(room * BASE64), lambda _: contents.weigh(cloud))
    lines = [*left_out, contents.not_shown, _reduced(scene, len(cloud))]
    return page(scene), [line for line in lines if line]


def _reduced(scene: Fitted, count: int) -> str:
    """What was left out, in words; empty where all is there."""
    if scene.kept == count:
        return ""
    return (
        f"Reduced to fit: {scene.kept:,} of {count:,} Gaussians, which make up "
        f"{scene.share:.1%} of what the photos show."
    )


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()
