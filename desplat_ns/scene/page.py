"""The HTML page of a scene: one file that needs no other and asks for none."""

from __future__ import annotations

import base64
import gzip
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import SplatCloud, moved, turned_harmonics
from desplat_ns.export.spz import color_bytes, placed, spz_bytes
from desplat_ns.files.pages import Picture, fitted_into, template
from desplat_ns.scene.contents import TO_PAGE, Contents

HERE = Path(__file__).parent
TEMPLATE = HERE / "page.html.jinja"
SCRIPTS = ("files.js", "cameras.js", "drawing.js", "frusta.js", "controls.js", "page.js")
IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE | re.DOTALL)
STYLE = HERE / "scene.css"
VIEWER = HERE / "viewer" / "viewer.js.gz"
WASM = HERE / "viewer" / "spark.wasm.gz"

PICTURES_SHARE, PICTURES_MOST = 0.4, 9_000_000
"""Of the page's bytes that pictures may take, and bytes that they take at most."""

BASE64 = 3 / 4
"""Bytes that a character of the page holds."""

LEAST = 100
"""Gaussians: with fewer there is no scene to speak of."""

MARGIN = 0.97
"""Of the bytes that are there: a reduced file's Gaussians take a little more each."""

LIGHTS_FRAME = 500
"""Bytes for a light beside its colours and its name, which is there twice and may be escaped."""


def html_of(contents: Contents, most: int) -> tuple[str, list[str]]:
    """The page, and lines about what is not on it.

    Args:
        most: bytes of the page.

    Raises:
        ConfigError: photos or Gaussians do not fit, however few or small.
    """
    pictures = [Picture(camera.photo) for camera in contents.cameras]
    pictures += [Picture(picture) for _, picture in contents.pictures]
    encoded = fitted_into(pictures, int(min(PICTURES_SHARE * most, PICTURES_MOST)))
    sources = iter(encoded.sources)
    cameras = []
    for index, camera in enumerate(contents.cameras):
        shown = {"index": index, "photo": next(sources), "distractors": ""}
        cameras.append({**camera.as_json(), **shown})
        if camera.distractors is not None:
            taken_out = moved(camera.distractors, TO_PAGE)
            taken_out = taken_out.rows(placed(taken_out)[0])
            cameras[-1]["distractors"] = _text(spz_bytes(taken_out))
    renderings = [(name, next(sources)) for name, _ in contents.pictures]
    near, left_out = placed(contents.cloud)
    cloud = contents.cloud.rows(near)

    def page(scene: Fitted | None, others: Sequence[dict[str, Any]] = ()) -> str:
        first = {"name": contents.light, "background": contents.background, "change": ""}
        return template(TEMPLATE).render(
            page=contents,
            scene="" if scene is None else _text(scene.content),
            kept=0 if scene is None else scene.kept,
            reduced="" if scene is None else _reduced(scene, len(cloud)),
            cameras=cameras,
            lights=[first, *others],
            data={"cameras": cameras, "lights": [first, *others]}
            | {"antialiased": cloud.antialiased},
            renderings=renderings,
            script=script(),
            style=STYLE.read_text("utf8"),
            viewer=_text(VIEWER.read_bytes()),
            wasm=_text(WASM.read_bytes()),
        )

    room = most - len(page(None).encode()) - 1_000
    turned = moved(cloud, TO_PAGE)
    scene = fitted(turned, int(room * BASE64), lambda _: contents.weigh(cloud))
    rows = near.nonzero()[0][scene.rows]
    one_light = len(page(scene).encode())
    others = _other_lights(
        contents, turned.rows(scene.rows), rows, min(one_light, most - one_light)
    )
    lines = [*left_out, contents.not_shown, _reduced(scene, len(cloud))]
    if scene.kept < len(cloud) and len(others) < len(contents.other_lights):
        lines.append(f"Room for {len(others)} of {len(contents.other_lights)} other lights.")
    return page(scene, others), [line for line in lines if line]


def _other_lights(
    contents: Contents, scene: SplatCloud, rows: Int[np.ndarray, " N"], room: int
) -> list[dict[str, Any]]:
    """Other lights as the page's script reads them, as many as there is room for.

    Of each there is what has to be added to the bytes of the first one's colours, modulo 256:
    most of it is 0, or nearly so, and packs well.

    Args:
        scene: as it is on the page.
        rows: which of the contents' Gaussians these are.
        room: bytes for all.
    """
    first, others = color_bytes(scene), []
    for light in contents.other_lights:
        harmonics = turned_harmonics(light.harmonics[rows], TO_PAGE.turn)
        change = color_bytes(replace(scene, harmonics=harmonics)) - first
        text = _text(gzip.compress(change.tobytes(), mtime=0))
        room -= len(text) + LIGHTS_FRAME + 10 * len(light.name.encode())
        if room < 0:
            break
        others.append({"name": light.name, "background": light.background, "change": text})
    return others


def script() -> str:
    """The page's own script: its modules in one, in the order in which they need one another."""
    texts = (path.read_text("utf8") for path in (HERE / "script" / name for name in SCRIPTS))
    return "\n".join(IMPORT.sub("", text) for text in texts)


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


@dataclass(frozen=True)
class Fitted:
    """A cloud as a file, and what was left out for it."""

    content: bytes
    """SPZ."""
    rows: Bool[np.ndarray, " N"]
    """Which of the cloud's Gaussians are kept."""
    share: float
    """Of the photos that what is kept makes up, in [0, 1]: blending weights over their sum."""

    @property
    def kept(self) -> int:
        """How many."""
        return int(self.rows.sum())


def fitted(
    cloud: SplatCloud, most: int, weigh: Callable[[SplatCloud], Float[np.ndarray, " N"]]
) -> Fitted:
    """The cloud as SPZ of at most so many bytes.

    Args:
        weigh: gives what each Gaussian makes up of the photos; called where not all fit.

    Raises:
        ConfigError: next to none fit.
    """
    content = spz_bytes(cloud)
    if len(content) <= most:
        return Fitted(content, np.ones(len(cloud), bool), 1.0)
    weights = weigh(cloud)
    order, count = np.argsort(-weights, kind="stable"), len(cloud)
    chosen = np.ones(count, bool)
    while len(content) > most:
        count = int(count * min(MARGIN * most / len(content), 0.99))
        if count < LEAST:
            raise ConfigError(
                f"Of {len(cloud)} Gaussians fewer than {LEAST} fit into {max(most, 0) / 1e6:.2f} "
                "MB, which is what the page has left for them. Give it more with --megabytes, or "
                "fewer photos with --training-photos and --held-out-photos."
            )
        chosen[:] = False
        chosen[order[:count]] = True
        content = spz_bytes(cloud.rows(chosen))
    return Fitted(content, chosen, float(weights[order[:count]].sum() / weights.sum()))
