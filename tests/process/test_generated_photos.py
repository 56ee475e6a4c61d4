"""The whole way on the generated yard, whose cameras are known: each recipe, masks, a video."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from desplat_ns.commands.process import run
from desplat_ns.layouts.recognition import recognise
from desplat_ns.process import video as video_module
from desplat_ns.process.request import Request
from tests.helpers.yard import CLOSE, EDGE, Yard, places_of, view_of, write_mask_of_the_mark

pytestmark = pytest.mark.slow


def recorded(output: Path) -> dict:
    """The stages that are done."""
    return json.loads((output / "process.json").read_text("utf8"))["stages"]


def test_plain_features_pose_all_photos_in_their_places(yard: Yard, tmp_path: Path, capsys):
    views = range(len(yard.pictures))
    photos, out = yard.write(tmp_path / "fotos über", views), tmp_path / "out"
    run(Request(photos, out, effort="plain", threads=1))
    assert "12 of 12 photos have a pose" in capsys.readouterr().out
    assert yard.farthest(out / "sparse" / "0", {f"{view:02d}.jpg": view for view in views}) < CLOSE
    assert recognise(out).match.layout.name == "COLMAP"
    assert (out / "cameras.png").is_file() and not (out / "work").exists()


def test_thorough_features_stay_off_what_a_mask_blackens_and_pose_all_photos(
    yard: Yard, tmp_path: Path
):
    """A pattern stands still in their lowest quarter. Few photos: it takes longer."""
    views = range(1, 11, 2)
    photos = yard.write(tmp_path / "photos", views, is_marked=True)
    mask, out = write_mask_of_the_mark(tmp_path / "mask.png"), tmp_path / "out"
    run(Request(photos, out, effort="thorough", mask=mask, threads=1, keep_work=True))
    places = np.concatenate([*places_of(out / "work" / "thorough" / "database.db").values()])
    assert len(places) > 0 and (places[:, 1] < EDGE + 1).all()
    assert not recorded(out)["matching (thorough)"]["result"]["left_out"]
    names = {f"{number:02d}.jpg": view for number, view in enumerate(views)}
    assert yard.farthest(out / "sparse" / "0", names) < CLOSE


def test_the_frames_of_a_video_have_their_places(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The camera looks at one middle, so that the picture moves little from view to view."""
    monkeypatch.setattr(video_module, "LEAST_GAP", video_module.STEP)
    video, out = yard.film(tmp_path / "walk.mp4"), tmp_path / "out"
    run(Request(video, out, effort="plain", threads=1))
    assert recorded(out)["matching (plain)"]["result"]["pairing"] == "sequential"
    views = {Path(name).stem: view_of(name) for name in recorded(out)["frames"]["result"]}
    assert yard.farthest(out / "sparse" / "0", {f"{n}.jpg": v for n, v in views.items()}) < CLOSE
