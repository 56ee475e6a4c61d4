"""Photos as they lie on people's disks: odd names, odd kinds, nothing in common, a call cut off."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pycolmap
import pytest

from desplat_ns.commands.process import run
from desplat_ns.errors import CaptureError
from desplat_ns.process import attempts, features
from desplat_ns.process.attempts import Attempt
from desplat_ns.process.cameras import group_by_camera
from desplat_ns.process.features import feature_counts, find_features
from desplat_ns.process.photos import prepare_photos
from desplat_ns.process.process import findings_of
from desplat_ns.process.recipes import PLAIN
from desplat_ns.process.request import Request
from desplat_ns.process.sources import find_sources
from desplat_ns.process.video import take_frames
from tests.helpers.yard import Yard, copied, silent


def noise(seed: int, height: int = 60, width: int = 80) -> np.ndarray:
    """A picture with detail everywhere and nothing in common with another seed's."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def save(path: Path, pixels: np.ndarray, **how: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(pixels).save(path, **how)


def test_pictures_in_hidden_folders_are_no_photos(tmp_path: Path):
    """As file managers and photo programs leave them: small copies, and what was before an edit."""
    names = [f"{i}.jpg" for i in range(3)]
    for name in (*names, ".thumbnails/0.jpg", "trip/.picasaoriginals/0.jpg"):
        save(tmp_path / name, noise(0))
    assert find_sources(tmp_path, tmp_path / "out").names == tuple(names)


@pytest.mark.parametrize("output", ["photos", "."])
def test_a_capture_is_not_made_in_or_around_the_folder_of_its_photos(tmp_path: Path, output: str):
    for i in range(3):
        save(tmp_path / "photos" / f"{i}.jpg", noise(i))
    with pytest.raises(CaptureError, match=r"The photos lie in the folder for the capture"):
        find_sources(tmp_path / "photos", tmp_path / output)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_name_that_is_no_text_is_named(tmp_path: Path):
    """As unpacked from an archive of an old system, whose umlauts have one byte."""
    for i in range(3):
        save(tmp_path / f"{i}.jpg", noise(i))
    os.rename(tmp_path / "1.jpg", os.fsencode(tmp_path) + b"/gr\xfcn.jpg")
    with pytest.raises(CaptureError, match=r"gr\\xfcn\.jpg.*Rename") as caught:
        find_sources(tmp_path, tmp_path / "out")
    str(caught.value).encode()  # it can be printed


KINDS: dict[str, tuple[Callable[[PIL.Image.Image], PIL.Image.Image], str, float]] = {
    "a.JPG": (lambda photo: photo, "JPEG", 40),
    "übers Meer 1.png": (lambda photo: photo, "PNG", 5),
    "palette.png": (lambda photo: photo.quantize(256), "PNG", 60),
    "cmyk.jpg": (lambda photo: photo.convert("CMYK"), "JPEG", 40),
    "webp called.jpg": (lambda photo: photo, "WEBP", 60),
    "grey and alpha.png": (lambda photo: photo.convert("LA"), "PNG", 255),
    "black and white.png": (lambda photo: photo.convert("1"), "PNG", 255),
}
"""How each file is made, and by how much of 255 the copy may be off in the mean."""


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_file_is_copied(tmp_path: Path, name: str):
    convert, kind, off = KINDS[name]
    smooth = np.asarray(PIL.Image.fromarray(noise(0, 6, 8)).resize((80, 60)))
    convert(PIL.Image.fromarray(smooth)).save(tmp_path / name, format=kind, quality=98)
    (photo,) = prepare_photos(tmp_path, [name], tmp_path / "copies", 1600, 1, lambda done: None)
    assert not photo.problem and (photo.width, photo.height) == (80, 60)
    with PIL.Image.open(tmp_path / "copies" / photo.copy) as copy:
        assert np.abs(np.asarray(copy).astype(float) - smooth).mean() < off


def test_files_that_are_no_pictures_are_named_and_do_not_stop_the_others(tmp_path: Path):
    save(tmp_path / "good.png", noise(0))
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "text.png").write_text("hello")
    (tmp_path / "half.jpg").write_bytes((tmp_path / "good.png").read_bytes()[:700])
    names = sorted(path.name for path in tmp_path.iterdir())
    photos = prepare_photos(tmp_path, names, tmp_path / "copies", 1600, 1, lambda done: None)
    problems = {photo.source: photo.problem for photo in photos}
    assert problems.pop("good.png") == ""
    assert all(problem.startswith("cannot be read: ") for problem in problems.values())


def test_a_video_of_three_frames_is_refused_with_its_number(yard: Yard, tmp_path: Path):
    three = Yard(yard.pictures[:1], yard.centres, yard.pixel)
    with pytest.raises(CaptureError, match=r"FILM Ä 1\.MP4 has 3 frames"):
        take_frames(three.film(tmp_path / "FILM Ä 1.MP4"), tmp_path / "frames", 150, silent)


def test_models_whose_photos_are_all_in_the_first_are_not_told():
    """COLMAP leaves a first try of two photos behind, which a better model has as well."""
    models = [
        {"photos": list("abcd"), "points": 9, "error": 0.5, "observations": 99},
        {"photos": list("ab"), "points": 2, "error": 0.5, "observations": 9},
        {"photos": list("dxy"), "points": 2, "error": 0.5, "observations": 9},
    ]
    assert findings_of(Attempt(PLAIN, models, []), 7)["others"] == [3]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages are not run in a process of their own, which takes seconds to start."""

    def run_job(folder: Any, label: str, job: str, arguments: dict[str, Any]) -> Any:
        module, _, name = job.rpartition(".")
        return getattr(import_module(module), name)(**arguments, progress=silent)

    monkeypatch.setattr(attempts, "run_job", run_job)


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(
    ("kind", "together"),
    [("noise", "0.png, 1.png, 2.png, 3.png: no matches"), ("bare", "0.png, 1"), ("tiny", "")],
)
def test_photos_that_share_nothing_are_told_together(tmp_path: Path, kind: str, together: str):
    for i in range(4):
        bare = np.full((60, 80, 3), 60 * i, np.uint8)
        pixels = {"noise": noise(i, 120, 160), "bare": bare, "tiny": noise(i, 1, 2)}[kind]
        save(tmp_path / "photos" / f"{i}.png", pixels)
    with pytest.raises(CaptureError, match=f"No three of the 4 photos.*{together}"):
        run(Request(tmp_path / "photos", tmp_path / "out", effort="plain", threads=1))


@pytest.mark.usefixtures("in_this_process")
def test_photos_that_are_the_same_but_for_noise_are_of_a_camera_that_stands(
    yard: Yard, tmp_path: Path
):
    for i in range(3):
        pixels = yard.pictures[0] + noise(i, *yard.pictures[0].shape[:2]) // 64
        save(tmp_path / "photos" / f"{i}.png", pixels.astype(np.uint8))
    with pytest.raises(CaptureError, match=r"The camera does not move.*walk around"):
        run(Request(tmp_path / "photos", tmp_path / "out", effort="plain", threads=1))


@pytest.mark.slow
@pytest.mark.parametrize("calls", [0, 1, 2])
def test_features_that_were_cut_off_go_on_where_they_stopped(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int
):
    """Cut off before the first call of pycolmap, after it, after the second."""
    photos = copied(yard.write(tmp_path / "photos", range(5)), tmp_path / "copies")
    cameras = group_by_camera(photos, "auto", "auto")
    database = tmp_path / "database.db"
    extract, asked = pycolmap.extract_features, []

    def noted(at: Path, folder: Path, names: list[str], **options: Any) -> None:
        if len(asked) == calls:
            raise KeyboardInterrupt
        asked.append(names)
        extract(at, folder, names, **options)

    monkeypatch.setattr(features.pycolmap, "extract_features", noted)
    with pytest.raises(KeyboardInterrupt):
        find_features(database, tmp_path / "copies", cameras, None, PLAIN, 1, silent)
    calls = 99
    find_features(database, tmp_path / "copies", cameras, None, PLAIN, 1, silent)
    assert sorted(name for names in asked for name in names) == [photo.copy for photo in photos], (
        "each once"
    )
    assert all(count for count in feature_counts(database).values())


@pytest.mark.slow
def test_photos_that_were_entered_in_part_share_their_camera_all_the_same(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    photos = copied(yard.write(tmp_path / "photos", range(5)), tmp_path / "copies")
    cameras = group_by_camera(photos, "auto", "auto")
    database = tmp_path / "database.db"
    enter = pycolmap.import_images

    def cut_off(at: Path, folder: Path, mode: Any, names: list[str], options: Any) -> None:
        enter(at, folder, mode, names[:2], options)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(features.pycolmap, "import_images", cut_off)
        with pytest.raises(KeyboardInterrupt):
            find_features(database, tmp_path / "copies", cameras, None, PLAIN, 1, silent)
    find_features(database, tmp_path / "copies", cameras, None, PLAIN, 1, silent)
    with pycolmap.Database.open(database) as db:
        (camera,) = db.read_all_cameras()
        images = db.read_all_images()
    assert camera.mean_focal_length() == pytest.approx(cameras[0].focal)
    assert {image.name for image in images} == {photo.copy for photo in photos}
