"""The whole way on the generated yard, whose cameras are known, and what a second call does."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.data.layouts import recognise
from desplat_ns.tools.process import process, video
from desplat_ns.tools.process.photos import Photo
from desplat_ns.tools.process.process import is_made, report_lines
from desplat_ns.tools.process.reconstruction import Attempt, Model
from desplat_ns.tools.process.request import Request
from tests.helpers.report import noise
from tests.helpers.yard import CLOSE, EDGE, SIZE, Yard, places_of, view_of, write_mask_of_the_mark


def findings_of(output: Path) -> dict[str, Any]:
    """What the record says of a capture that is made."""
    return json.loads((output / "process.json").read_text("utf8"))["findings"]


def test_plain_features_pose_all_photos_in_their_places(yard: Yard, tmp_path: Path):
    views = range(len(yard.pictures))
    photos, out = yard.write(tmp_path / "fotos über", views), tmp_path / "out"
    opaque = np.full((*yard.pictures[0].shape[:2], 1), 255, np.uint8)
    opaque[:60] = 0
    PIL.Image.fromarray(np.dstack([yard.pictures[0], opaque])).save(photos / "00.png")
    (photos / "cut off.png").write_bytes((photos / "00.png").read_bytes()[:5000])
    Request(photos, out, effort="plain").main()
    assert (findings_of(out)["photos"], findings_of(out)["of"]) == (12, 12)
    names = {f"{view:02d}.{'jpg' if view else 'png'}": view for view in views}
    assert yard.farthest(out / "sparse" / "0", names) < CLOSE
    assert {path.name for path in (out / "images").iterdir()} == names.keys()
    alpha = np.array(PIL.Image.open(out / "images" / "00.png"))[..., 3]
    assert (alpha[:50] == 0).all() and (alpha[70:] == 255).all()  # the lens bends little
    assert recognise(out).layout == "COLMAP"
    assert (out / "cameras.png").is_file() and not (out / "work").exists()
    before = (out / "process.json").read_bytes()
    Request(photos, out, effort="plain").main()
    assert (out / "process.json").read_bytes() == before and not (out / "work").exists()


def test_thorough_features_stay_off_what_a_mask_blackens_and_pose_all_photos(
    yard: Yard, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """A pattern stands still in their lowest quarter. Few photos: it takes longer. COLMAP's log,
    whose lines begin as `I20260101 12:00`, is not said."""
    views = range(1, 11, 2)
    photos = yard.write(tmp_path / "photos", views, is_marked=True)
    mask, out = write_mask_of_the_mark(tmp_path / "mask.png"), tmp_path / "out"
    Request(photos, out, effort="thorough", mask=mask, keep_work=True).main()
    assert not re.search(r"(?m)^[IWEF]\d{8} |adjustment", "".join(capfd.readouterr()))
    place = out / "work" / "thorough"
    places = np.concatenate([*places_of(place / "database.db").values()])
    assert len(places) > 0 and (places[:, 1] < EDGE + 1).all()
    names = {f"{number:02d}.jpg": view for number, view in enumerate(views)}
    assert yard.farthest(out / "sparse" / "0", names) < CLOSE


def test_the_frames_of_a_video_have_their_places(yard: Yard, tmp_path: Path, monkeypatch):
    """The camera looks at one middle, so that the picture moves little from view to view."""
    monkeypatch.setattr(video, "LEAST_GAP", video.STEP)
    film, out = yard.film(tmp_path / "walk.mp4"), tmp_path / "out"
    Request(film, out, effort="plain").main()
    views = {path.name: view_of(path.name) for path in (out / "images").iterdir()}
    assert yard.farthest(out / "sparse" / "0", views) < CLOSE


@pytest.mark.parametrize("kind", ["noise", "bare", "tiny", "one place"])
def test_photos_that_share_nothing_or_one_place_are_refused(tmp_path: Path, yard: Yard, kind: str):
    (tmp_path / "photos").mkdir()
    for i in range(4):
        bare = np.full((60, 80, 3), 60 * i, np.uint8)
        same = yard.pictures[0] + noise(i, *SIZE) // 64
        kinds = {"noise": noise(i, 160, 120), "bare": bare, "tiny": noise(i, 2, 1)}
        pixels = kinds.get(kind, same.astype(np.uint8))
        PIL.Image.fromarray(pixels).save(tmp_path / "photos" / f"{i}.png")
    said = "camera does not move" if kind == "one place" else r"0\.png"
    with pytest.raises(CaptureError, match=said):
        Request(tmp_path / "photos", tmp_path / "out", effort="plain").main()


def attempts(monkeypatch: pytest.MonkeyPatch, with_exif: Model, without: Model) -> list[str]:
    """Stands in for pycolmap's part; what is returned fills with the recipes that are asked for."""
    asked = []

    def reconstruct(request: Request, photos: list[Photo], recipe: Any) -> Attempt:
        asked.append(recipe.name)
        model = with_exif if any(photo.focal for photo in photos) else without
        return Attempt(recipe, [model], dict.fromkeys((photo.copy for photo in photos), 9), [])

    monkeypatch.setattr(process, "reconstruct", reconstruct)
    return asked


COPIES = tuple(f"{number:05d}.jpg" for number in range(1, 10))
GOOD = Model(Path("good"), COPIES, 5000, 9000, 0.4, 480)
BENT, FEWER = replace(GOOD, error=0.8), replace(GOOD, photos=COPIES[:8])


@pytest.mark.parametrize(
    ("with_exif", "without", "taken"),
    [
        (replace(GOOD, photos=COPIES[:2]), GOOD, "without"),
        (BENT, GOOD, "without"),
        (GOOD, GOOD, "with"),
        (FEWER, replace(FEWER, observations=9001), "with"),
    ],
)
def test_where_focal_lengths_of_exif_do_harm_they_are_named_and_left_out(
    tmp_path: Path, monkeypatch, capsys, with_exif: Model, without: Model, taken: str
):
    photos = [
        Photo(copy, copy, copy, width=400, height=300, sharpness=9.0, camera="A", focal_35mm=135.0)
        for copy in COPIES
    ]
    asked = attempts(monkeypatch, with_exif, without)
    request = Request(tmp_path, tmp_path / "out", effort="plain")
    best = process._best_attempt(request, photos)
    assert best.models[0] is (without if taken == "without" else with_exif)
    assert ("135 mm" in capsys.readouterr().out) == (taken == "without")
    assert len(asked) == (1 if with_exif is GOOD else 2)


def test_two_photos_with_a_pose_are_no_capture(photo_writer, tmp_path: Path, monkeypatch):
    for seed in range(3):
        photo_writer(tmp_path / "photos" / f"{seed}.png", 60, 40, seed=seed)
    attempts(monkeypatch, GOOD, replace(GOOD, photos=COPIES[:2]))
    with pytest.raises(CaptureError, match=r"2\.png"):
        Request(tmp_path / "photos", tmp_path / "out", effort="plain").main()
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("photos", "observations", "is_bent"),
    [(4, 2000, False), (20, 900, False), (20, 20_000, True), (20, 20_000, False)],
)
def test_few_photos_or_points_are_said_and_what_is_bent_is_nothing_to_train_with(
    photos: int, observations: int, is_bent: bool
):
    found = {"photos": photos, "observations": observations, "is_bent": is_bent}
    found |= {"of": 20, "points": 5, "error": 0.5, "left_out": {}}
    lines = report_lines(Path("out"), found)
    is_warned = any(line.startswith("Warning") for line in lines)
    assert is_warned == (is_bent or observations < 20_000)
    assert any("ns-train" in line for line in lines) != is_bent


def test_other_photos_or_options_are_listed_together(tmp_path: Path):
    is_made(tmp_path, {"--longest-side": "1600", "a": "1 bytes", "b": "1 bytes"})
    with pytest.raises(ConfigError) as caught:
        is_made(tmp_path, {"--longest-side": "800", "a": "2 bytes", "c": "1 bytes"})
    assert ": --longest-side, a, c, b." in str(caught.value)
    (tmp_path / "process.json").write_text("[]")
    with pytest.raises(ConfigError, match=r"process\.json"):
        is_made(tmp_path, {})


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path):
    (tmp_path / "thesis.doc").write_bytes(b"x")
    with pytest.raises(ConfigError, match=r"thesis\.doc"):
        is_made(tmp_path, {})
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.doc"]
