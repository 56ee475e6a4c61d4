"""The HTML page of a scene: one file that needs no other and asks for none."""

import base64
import gzip
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from desplat_ns.core.console import announce
from desplat_ns.core.errors import ConfigError
from desplat_ns.core.pages import fitted_into, template
from desplat_ns.core.run_files import RunFiles
from desplat_ns.core.whole import write_output
from desplat_ns.tools.commands.export import Page
from desplat_ns.tools.export.splat_cloud import SplatCloud, moved, turned_harmonics
from desplat_ns.tools.export.spz import color_bytes, placed, spz_bytes
from desplat_ns.tools.loading import load_run
from desplat_ns.tools.scene.gather import TO_PAGE, PageScene, scene_of

HERE = Path(__file__).parent
VIEWER = HERE / "viewer"
SCRIPTS = ("files.js", "cameras.js", "drawing.js", "frusta.js", "controls.js", "page.js")
IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE | re.DOTALL)
PICTURES_SHARE, PICTURES_MOST = 0.4, 9_000_000
"""Of the page's bytes that pictures may take, and bytes that they take at most."""
BASE64 = 3 / 4
"""Bytes that a character of the page holds."""
LEAST = 100
"""Gaussians: with fewer there is no scene to speak of."""
MARGIN = 0.97
"""Of the bytes that are there: a reduced file's Gaussians take a little more each."""


def write_scene(files: RunFiles, asked: Page) -> None:
    """Write the page of a run's scene; say what it lacks. Raises as `scene_of`, `scene_html`."""
    photos = asked.training_photos, asked.held_out_photos
    contents = scene_of(load_run(files), *photos, asked.crop, asked.light)
    text, left_out = scene_html(contents, int(asked.megabytes * 1e6))
    content = text.encode()
    write_output(asked.output, content)
    announce(f"Saved {asked.output}: a page with the scene in it, {len(content) / 1e6:.1f} MB.")
    for line in left_out:
        announce(line, warning=True)


def scene_html(contents: PageScene, most: int) -> tuple[str, list[str]]:
    """The page, of at most so many bytes, and lines about what is not on it. Raises ConfigError
    where photos or Gaussians do not fit, however few or small."""
    pictures = [camera.photo for camera in contents.cameras]
    pictures += [picture for _, picture in contents.pictures]
    sources = iter(fitted_into(pictures, int(min(PICTURES_SHARE * most, PICTURES_MOST))))
    cameras = []
    for index, camera in enumerate(contents.cameras):
        distractors = ""
        if camera.distractors is not None:
            taken_out = moved(camera.distractors, TO_PAGE)
            distractors = _text(spz_bytes(taken_out.rows(placed(taken_out)[0])))
        shown = {"index": index, "photo": next(sources), "distractors": distractors}
        cameras.append({**camera.as_json(), **shown})
    renderings = [(name, next(sources)) for name, _ in contents.pictures]
    near, told = placed(contents.cloud)
    cloud = contents.cloud.rows(near)

    def page(scene: str, kept: int, reduced: str = "", others: Sequence[Any] = ()) -> str:
        first = {"name": contents.light, "background": contents.background, "change": ""}
        return template(HERE / "page.html.jinja").render(
            page=contents,
            scene=scene,
            kept=kept,
            reduced=reduced,
            cameras=cameras,
            lights=[first, *others],
            data={"cameras": cameras, "lights": [first, *others], "antialiased": cloud.antialiased},
            renderings=renderings,
            script=script(),
            style=(HERE / "scene.css").read_text("utf8"),
            viewer=_text((VIEWER / "viewer.js.gz").read_bytes()),
            wasm=_text((VIEWER / "spark.wasm.gz").read_bytes()),
        )

    room = most - len(page("", 0).encode()) - 1_000
    turned, reduced = moved(cloud, TO_PAGE), ""
    content, chosen, share = fitted(turned, int(room * BASE64), lambda _: contents.weigh(cloud))
    shown = turned.rows(chosen)
    if len(shown) < len(cloud):
        kept = f"{len(shown):,} of {len(cloud):,} Gaussians"
        reduced = f"Reduced to fit: {kept}, which make up {share:.1%} of what the photos show."
    rows = near.nonzero()[0][chosen]
    scene = _text(content), len(shown), reduced
    limit, others = min(2 * len(page(*scene).encode()), most), list[dict[str, Any]]()
    for light in contents.other_lights:
        # What has to be added to the bytes of the first light's colours, modulo 256, packs well.
        harmonics = turned_harmonics(light.harmonics[rows], TO_PAGE.turn)
        change = color_bytes(replace(shown, harmonics=harmonics)) - color_bytes(shown)
        text = _text(gzip.compress(change.tobytes(), mtime=0))
        others.append({"name": light.name, "background": light.background, "change": text})
        if len(page(*scene, others).encode()) > limit:
            others.pop()
            break
    return page(*scene, others), [line for line in (told, contents.not_shown, reduced) if line]


def script() -> str:
    """The page's own script: its modules in one, in the order in which they need one another."""
    texts = (path.read_text("utf8") for path in (HERE / "script" / name for name in SCRIPTS))
    return "\n".join(IMPORT.sub("", text) for text in texts)


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def fitted(
    cloud: SplatCloud, most: int, weigh: Callable[[SplatCloud], Float[np.ndarray, " N"]]
) -> tuple[bytes, Bool[np.ndarray, " N"], float]:
    """The cloud as SPZ of at most so many bytes; which Gaussians are kept; and the share of the
    photos that they make up, in [0, 1]: blending weights, which `weigh` gives where not all fit,
    over their sum. Raises ConfigError where next to none fit."""
    content = spz_bytes(cloud)
    if len(content) <= most:
        return content, np.ones(len(cloud), bool), 1.0
    weights, count = weigh(cloud), len(cloud)
    order = np.argsort(-weights, kind="stable")
    chosen = np.ones(count, bool)
    while len(content) > most:
        count = int(count * min(MARGIN * most / len(content), 0.99))
        if count < LEAST:
            raise ConfigError(
                f"Of {len(cloud)} Gaussians fewer than {LEAST} fit into {max(most, 0) / 1e6:.2f} "
                "MB, which is what the page has left for them. Give it more with --megabytes, or "
                "fewer photos with --training-photos and --held-out-photos."
            )
        chosen[order[count:]] = False
        content = spz_bytes(cloud.rows(chosen))
    return content, chosen, float(weights[order[:count]].sum() / weights.sum())
