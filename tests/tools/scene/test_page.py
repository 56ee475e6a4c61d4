"""The page of a scene as a file: what is in it, that it is closed, escaped, and not too large."""

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from desplat_ns.cameras.views import image_points
from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.export.splat_cloud import SplatCloud, moved
from desplat_ns.tools.export.spz import color_bytes, spz_bytes
from desplat_ns.tools.scene.gather import TO_PAGE
from desplat_ns.tools.scene.page import fitted, scene_html
from tests.helpers.html import Elements
from tests.helpers.scene import HEIGHT, WIDTH, camera, cloud, contents, light, red_disc
from tests.helpers.splat_files import read_splats

MOST = 4_000_000
NASTY = "</script><script>alert(1)</script><!--<script>\"'&\u2028.png"


def test_the_scene_its_cameras_and_what_was_taken_out_are_in_the_page():
    text, said = scene_html(contents(), MOST)
    parts, made = Elements(text), contents()
    read = read_splats(base64.b64decode(parts.text_of("scene")))
    turned = np.stack([made.cloud.means[:, 0], made.cloud.means[:, 2], -made.cloud.means[:, 1]], 1)
    assert np.allclose(read.means, turned, atol=1e-5), "y is up in the page"
    data = json.loads(parts.text_of("data"))
    assert [camera["name"] for camera in data["cameras"]] == ["a.png", "b.png", "extra.png"]
    assert [camera["heldOut"] for camera in data["cameras"]] == [False, False, True]
    taken = [bool(camera["distractors"]) for camera in data["cameras"]]
    assert taken == [True, False, False]
    disc = gzip.decompress(base64.b64decode(data["cameras"][0]["distractors"]))
    assert int.from_bytes(disc[8:12], "little") == len(red_disc()), "SPZ's number of points"
    assert "2026-01-31, 300 Gaussians" in text
    assert said == []


def test_nothing_is_asked_from_elsewhere():
    text, _ = scene_html(contents(), MOST)
    parts = Elements(text)
    policy = next(a["content"] for a, _ in parts.of("meta") if "http-equiv" in a)
    assert policy is not None and "default-src 'none'" in policy and "connect-src" not in policy
    addresses = [a.get("src") or a.get("href") for _, a, _ in parts.all]
    assert all(address.startswith("data:") for address in addresses if address)
    assert re.findall(r"https?://[^\s\"'<]+", text) == []


def test_names_with_markup_in_them_do_no_harm():
    plain = contents(light="a.png", other_lights=[light("b.png")])
    nasty = contents(
        title=NASTY,
        light=NASTY,
        other_lights=[light(NASTY)],
        not_shown=NASTY,
        cameras=[camera(NASTY, 0), *plain.cameras[1:]],
        pictures=[(NASTY, plain.pictures[0][1])],
    )
    before, after = (Elements(scene_html(page, MOST)[0]) for page in (plain, nasty))
    tags = [[tag for tag, _, _ in parts.all] for parts in (before, after)]
    assert tags[0] == tags[1], "the same elements"
    assert json.loads(after.text_of("data"))["cameras"][0]["name"] == NASTY
    assert NASTY in [text.strip() for _, text in after.of("title")]
    assert "".join(text for _, text in after.of("option")).count(NASTY) == 3


def test_other_lights_are_what_is_to_be_added_to_the_first_ones_colours():
    """All bytes of the file in that light, rounded as it would be, and no bytes beside."""
    written = contents(light="a.png", other_lights=[light("b.png", 0.3)])
    data = json.loads(Elements(scene_html(written, MOST)[0]).text_of("data"))
    first, other = data["lights"]
    assert (first["name"], first["change"]) == ("a.png", "")
    assert (other["name"], other["background"]) == ("b.png", [0.1, 0.2, 0.7])
    lit = replace(written.cloud, harmonics=written.other_lights[0].harmonics)
    before, after = (color_bytes(moved(cloud, TO_PAGE)) for cloud in (written.cloud, lit))
    change = np.frombuffer(gzip.decompress(base64.b64decode(other["change"])), np.uint8)
    assert (before + change == after).all() and (change != 0).any()


def test_a_page_is_as_large_as_it_may_be_and_says_what_is_left_out():
    large = cloud(count=30_000)
    most = 1_500_000
    lit = contents(cloud=large, other_lights=[light("b", 0.1, large)])
    reduced, (line,) = scene_html(lit, most)
    assert 0.9 * most < len(reduced.encode()) <= most
    kept = re.search(r"([\d,]+) of 30,000", line)
    assert kept is not None and line in reduced
    parts = Elements(reduced)
    read = read_splats(base64.b64decode(parts.text_of("scene")))
    assert len(read) == int(kept[1].replace(",", ""))
    assert len(json.loads(parts.text_of("data"))["lights"]) == 1


@pytest.mark.parametrize("degrees", [0, -70, 180])
def test_a_point_of_the_page_is_seen_where_our_camera_sees_it(degrees: float):
    """OpenGL's camera looks along -z with y up: x = c_x - f_x X / Z, y = c_y + f_y Y / Z."""
    photo = camera("a.png", degrees)
    record = photo.as_json()
    points = np.random.default_rng(0).normal(size=(20, 3)) * 0.3
    pose = np.array(record["pose"]).reshape(4, 4).T
    in_page = points @ TO_PAGE.turn.T
    in_camera = (in_page - pose[:3, 3]) @ pose[:3, :3]
    fx, fy, cx, cy = record["lens"]
    assert (in_camera[:, 2] < 0).all()
    x = cx - fx * in_camera[:, 0] / in_camera[:, 2]
    y = cy + fy * in_camera[:, 1] / in_camera[:, 2]
    u, v, _ = image_points(torch.from_numpy(points), photo.view)
    assert np.allclose(x, u * WIDTH) and np.allclose(y, v * HEIGHT)


def by_opacity(splats: SplatCloud) -> np.ndarray:
    return splats.opacities.astype(np.float64)


@pytest.mark.parametrize("part", [0.9, 0.5])
def test_what_shows_most_is_kept_and_its_share_is_told(part: float):
    whole = cloud(count=1000)
    most = int(part * len(spz_bytes(whole)))
    content, rows, share = fitted(whole, most, by_opacity)
    assert 0.9 * most <= len(content) <= most, "not less than need be"
    kept = np.sort(whole.opacities)[len(whole) - rows.sum() :]
    read = np.sort(read_splats(content).opacities)
    assert np.allclose(read, kept, atol=0.01), "a byte holds an opacity"
    assert share == pytest.approx(kept.sum() / whole.opacities.sum(), rel=1e-6)


@pytest.mark.parametrize("most", [1000, -5])
def test_next_to_no_room_is_an_error_that_says_what_to_do(most: int):
    with pytest.raises(ConfigError, match="--megabytes"):
        fitted(cloud(), most, by_opacity)
