"""The page in a real browser that draws on the CPU: it shows what we render, and moves."""

import base64
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from desplat_ns.tools.export.ply import ply_bytes
from desplat_ns.tools.export.splat_cloud import SplatCloud
from desplat_ns.tools.export.spz import spz_bytes
from desplat_ns.tools.scene.gather import PageScene
from desplat_ns.tools.scene.page import scene_html
from tests.helpers.browser import Page, headless_page
from tests.helpers.scene import (
    HEIGHT,
    PHOTO,
    WIDTH,
    camera,
    cloud,
    contents,
    drawn,
    light,
    psnr,
    red_disc,
)

pytestmark = pytest.mark.slow

MOST = 4_000_000
LEAST_PSNR = 30.0
"""dB, of the page's picture against ours."""


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
def bare_scene(path: Path, scene: PageScene) -> Iterator[Page]:
    """The stage of a scene's page alone, as large as a photo."""
    path.write_text(scene_html(scene, MOST)[0])
    with headless_page(webgl=True) as page:
        page.resize(WIDTH, HEIGHT)
        opened(page, path)
        bare(page)
        yield page


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scene") / "scene.html"


@pytest.fixture(scope="module")
def page(address: Path) -> Iterator[Page]:
    with headless_page(webgl=True) as browser:
        browser.resize(WIDTH, HEIGHT)
        address.write_text(scene_html(contents(), MOST)[0])
        opened(browser, address)
        yield browser


@pytest.fixture()
def stage(page: Page) -> Iterator[Page]:
    """The page at the first photo's camera, without its controls, as large as a photo."""
    page.resize(WIDTH, HEIGHT)
    bare(page)
    settle(page, "scenePage.setMode(false), scenePage.goTo(0)")
    yield page
    page.value("document.getElementById('bare').remove()")
    for name in ("distractors", "frusta"):
        page.value(f"if ({name}.checked) {name}.click()")
    page.value("share.value = 0, share.oninput()")


@pytest.mark.parametrize("index", range(3))
def test_at_a_photos_camera_it_shows_what_we_render(stage: Page, index: int):
    settle(stage, f"scenePage.goTo({index})")
    ours = drawn(contents().cloud, contents().cameras[index].view)
    assert psnr(shown(stage), ours) > LEAST_PSNR


def test_another_light_is_shown_where_it_is_chosen_and_the_first_one_again(tmp_path: Path):
    other = light("b.png")
    scene = contents(light="a.png", other_lights=[other])
    view = scene.cameras[1].view
    ours = drawn(scene.cloud, view)
    lit = drawn(replace(scene.cloud, harmonics=other.harmonics), view, other.background)
    assert psnr(ours, lit) < 20
    with bare_scene(tmp_path / "a.html", scene) as page:
        settle(page, "scenePage.goTo(1)")
        first = shown(page)
        assert psnr(first, ours) > LEAST_PSNR
        select = "(at => { const it = document.getElementById('light'); it.value = at; "
        settle(page, select + "it.onchange() })(1)")
        assert psnr(shown(page), lit) > LEAST_PSNR
        assert page.value("document.getElementById('lit').textContent") == "in the light of b.png"
        settle(page, select + "it.onchange() })(0)")
        assert (shown(page) == first).all(), "to the bit"


@pytest.mark.parametrize(("degree", "antialiased"), [(1, False), (3, True)])
def test_strong_harmonics_are_drawn_whole(tmp_path: Path, degree: int, antialiased: bool):
    """Spark cuts the largest of a coefficient's three channels off at a power of two. SPZ's
    rounding of colours alone would leave 40 dB (tests/export)."""
    plain = cloud(degree=degree)
    strong = plain.harmonics * np.where(np.arange((degree + 1) ** 2) > 0, 4, 1)[:, None]
    strong = replace(plain, harmonics=strong.astype(np.float32), antialiased=antialiased)
    scene = contents(cloud=strong)
    with bare_scene(tmp_path / "a.html", scene) as page:
        settle(page, "scenePage.goTo(1)")
        assert psnr(shown(page), drawn(scene.cloud, scene.cameras[1].view)) > 40


def test_what_was_taken_out_can_be_put_back_and_fades_away_from_its_camera(stage: Page):
    without = shown(stage)
    assert stage.value("distractors.disabled") is False
    settle(stage, "distractors.click()")
    stage.wait_for("scenePage.taken.size === 1 && scenePage.front.spark.activeSplats > 0")
    settle(stage)
    put_back = np.abs(shown(stage) - without).max(axis=2) > 0.2
    red = shown(stage)[put_back].mean(axis=0)
    assert put_back.mean() > 0.005 and red[0] > 0.8 and red[1:].max() < 0.4
    assert "so it fades as you leave" in stage.value("note.textContent")
    settle(stage, "scenePage.camera.position.x += 3")
    away = shown(stage)
    settle(stage, "distractors.click()")
    assert np.abs(away - shown(stage)).max() < 0.01, "nothing of it is left"
    settle(stage, "scenePage.goTo(1)")
    assert stage.value("distractors.disabled") is True, "nothing was taken out of this one"


@pytest.mark.parametrize("flying", [False, True])
@pytest.mark.parametrize("by_keys", [False, True])
def test_dragging_and_arrow_keys_turn_the_camera(stage: Page, flying: bool, by_keys: bool):
    place = "[...scenePage.camera.position, ...scenePage.camera.quaternion]"
    settle(stage, f"scenePage.setMode({str(flying).lower()})")
    before, picture = stage.value(place), shown(stage)
    stage.press("ArrowRight", 39) if by_keys else stage.drag((100, 75), (150, 85))
    stage.wait_for(f"JSON.stringify({place}) !== {str(before).replace(' ', '')!r}")
    settle(stage)
    moved = np.abs(np.subtract(before, stage.value(place)))
    assert moved[3:].max() > 0.01, "it turns"
    assert flying == bool(moved[:3].max() < 1e-6), "an orbit carries it along"
    assert psnr(shown(stage), picture) < LEAST_PSNR


def test_a_finger_turns_the_scene_and_keys_walk_and_lead_back(stage: Page):
    place = "[...scenePage.camera.position]"
    stage.value("globalThis.turn = scenePage.camera.quaternion.clone(), 0")
    before = stage.value(place)
    stage.swipe((2, 75), (WIDTH - 2, 75))
    settle(stage)
    turned = stage.value(place)
    angle = np.degrees(stage.value("scenePage.camera.quaternion.angleTo(turn)"))
    assert 30 < angle < 90, "a thumb that crosses the phone turns it by less than a quarter"
    stage.call("Input.dispatchKeyEvent", type="rawKeyDown", key="w", code="KeyW")
    stage.wait_for(f"scenePage.camera.position.length() < {np.linalg.norm(turned) - 0.1}")
    stage.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")
    stage.press("n", 78)
    assert stage.value("scenePage.current") == 1
    stage.press("Home", 36)
    settle(stage)
    assert stage.value("scenePage.current") == 0 and stage.value(place) == before


def test_keys_walk_after_a_photo_was_chosen(stage: Page):
    stage.value("document.getElementById('bare').remove(), camera.focus()")
    stage.value("globalThis.before = scenePage.camera.position.clone(), 0")
    stage.call("Input.dispatchKeyEvent", type="rawKeyDown", key="w", code="KeyW")
    stage.wait_for("scenePage.camera.position.distanceTo(before) > 0.05")
    stage.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")
    assert stage.value("scenePage.current") == 0, "no other photo was chosen"
    bare(stage)


@pytest.mark.parametrize(
    ("kind", "write", "axes"), [("ply", ply_bytes, (1, -1, -1)), ("spz", spz_bytes, (1, 1, 1))]
)
def test_a_dropped_file_is_shown_in_place_of_the_scene(tmp_path: Path, kind: str, write, axes):
    dropped = cloud(seed=7, degree=0)
    content = base64.b64encode(write(dropped)).decode()
    with bare_scene(tmp_path / "a.html", contents()) as page:
        page.value(
            f"{{ const bytes = Uint8Array.from(atob('{content}'), c => c.charCodeAt(0));"
            f"scenePage.showFile(new File([bytes], 'a.{kind}')), 0 }}"
        )
        page.wait_for("document.body.matches('.dropped')")
        settle(page)
        pose = np.array(page.value("[...scenePage.camera.matrixWorld.elements]")).reshape(4, 4).T
        to_file = np.diag([*axes, 1.0])
        viewmat = np.linalg.inv(to_file @ pose @ np.diag([1.0, -1.0, -1.0, 1.0]))
        view = replace(contents().cameras[0].view, viewmat=torch.from_numpy(viewmat))
        ours = drawn(dropped, view)
        assert ours.std() > 0.05, "it is in view"
        assert psnr(shown(page), ours) > LEAST_PSNR


def test_the_photo_lies_over_the_scene_up_to_the_slider(stage: Page):
    settle(stage, "share.value = 50, share.oninput()")
    stage.wait_for("getComputedStyle(photo).opacity === '1'")
    picture = shown(stage)
    is_photo = np.abs(picture - np.array(PHOTO) / 255).max(axis=2) < 0.05
    assert is_photo[:, : WIDTH // 2 - 2].all() and not is_photo[:, WIDTH // 2 + 2 :].any()


def test_what_is_nearer_than_the_near_plane_is_not_shown_there(tmp_path: Path):
    """The disc hangs 0.8 units before the first camera; the plane lies at 1."""
    scene, disc = cloud(degree=0), red_disc()
    both = joined(scene, disc)
    page_data = contents(cloud=both, cameras=[camera("a.png", 0, near=1.0), camera("b.png", 40)])
    with bare_scene(tmp_path / "a.html", page_data) as page:
        settle(page, "scenePage.goTo(0)")
        hidden = shown(page)
        assert psnr(hidden, drawn(scene, page_data.cameras[0].view)) > LEAST_PSNR
        assert psnr(hidden, drawn(both, page_data.cameras[0].view)) < LEAST_PSNR


def joined(*clouds: SplatCloud) -> SplatCloud:
    """All Gaussians of several, which have the same harmonics' degree."""
    names = ("means", "quats", "scales", "opacities", "harmonics")
    return replace(
        clouds[0], **{name: np.concatenate([getattr(c, name) for c in clouds]) for name in names}
    )


def test_no_request_leaves_the_page_and_nothing_goes_wrong(page: Page, address: Path):
    """The last of this module: it hears of all that the others did."""
    own = [request for request in page.requests() if not request.startswith(("data:", "blob:"))]
    assert own == [address.as_uri()]
    wrong = [e for e in page.events if e["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
    said = [e for e in page.events if e["method"] == "Runtime.consoleAPICalled"]
    assert wrong == [] and said == []


def test_without_webgl_it_says_so_and_shows_pictures(tmp_path: Path):
    path = tmp_path / "a.html"
    path.write_text(scene_html(contents(), MOST)[0])
    with headless_page() as page:
        opened(page, path)
        assert "has no WebGL 2" in page.value("document.getElementById('status').textContent")
        box = page.value("document.querySelector('#pictures img').getBoundingClientRect().toJSON()")
        assert box["width"] > 100 and box["height"] > 50
        assert page.value("getComputedStyle(document.querySelector('footer')).display") == "none"
        wrong = [e for e in page.events if e["method"] == "Runtime.exceptionThrown"]
        assert wrong == []
