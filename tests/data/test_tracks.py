from __future__ import annotations

import copy
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
import pytest

from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.tracks import METADATA_KEY, Tracks
from desplat_ns.errors import CaptureError
from desplat_ns.survey.observations import capture_of, observe


def tracks_of(folder: Path) -> Tracks:
    outputs = RobustNerfDataParserConfig(data=folder).setup().get_dataparser_outputs("train")
    return outputs.metadata[METADATA_KEY]


def test_photos_observe_the_points_that_they_show_and_nothing_hides(tiny_scene):
    observed = tracks_of(tiny_scene.folder).read([0, 3])
    shown = tiny_scene.points.is_seen[: tiny_scene.spec.num_views] & ~tiny_scene.is_occluded()
    for photo, track in zip((0, 3), observed, strict=True):
        np.testing.assert_array_equal(np.sort(track.points), np.flatnonzero(shown[photo]))
        assert ((track.places > -0.1) & (track.places < 1.1)).all()


def test_points_that_are_left_out_are_not_observed(tiny_scene):
    tracks = tracks_of(tiny_scene.folder)
    keep = np.arange(len(tracks.point_ids)) % 2 == 0
    (all_of_them,) = tracks.read([1])
    (rest,) = tracks.keep(keep).read([1])
    kept = keep[all_of_them.points]
    np.testing.assert_array_equal(2 * rest.points, all_of_them.points[kept])
    np.testing.assert_array_equal(rest.places, all_of_them.places[kept])


def test_tracks_are_small_and_survive_a_copy(tiny_scene):
    tracks = copy.deepcopy(tracks_of(tiny_scene.folder))
    assert len(tracks.image_ids) == tiny_scene.spec.num_views
    assert len(tracks.read([0])[0].points) > 0


def test_a_reconstruction_that_is_gone_is_an_error(tiny_scene, tmp_path):
    tracks = tracks_of(tiny_scene.folder)
    gone = replace(tracks, folder=tmp_path / "gone")
    with pytest.raises(CaptureError, match="gone"):
        gone.read([0])


@pytest.mark.parametrize("form", ["binary", "text"])
def test_observations_are_those_that_pycolmap_reads(tiny_scene, tmp_path: Path, form: str):
    """Also of a photo with observations of no point, and of one that observes nothing."""
    data = Path(shutil.copytree(tiny_scene.folder, tmp_path / "scene"))
    folder = data / "sparse" / "0"
    model = pycolmap.Reconstruction(folder)
    numbers = sorted(model.images)
    for photo, gone in ((0, 3), (2, model.images[numbers[2]].num_points2D())):
        for index in range(gone):
            model.delete_observation(numbers[photo], index)
    shutil.rmtree(folder)
    folder.mkdir()
    model.write_binary(folder) if form == "binary" else model.write_text(folder)
    parser = DeSplatColmapDataParserConfig(data=data, eval_mode="all")
    tracks = parser.setup().get_dataparser_outputs("train").metadata[METADATA_KEY]
    order = list(reversed(range(len(numbers))))
    lost = 0
    for photo, track in zip(order, tracks.read(order), strict=True):
        image = model.images[tracks.image_ids[photo]]
        tracked = image.get_observation_points2D()
        lost += image.num_points2D() - len(tracked)
        expected = [point.point3D_id for point in tracked]
        np.testing.assert_array_equal(tracks.point_ids[track.points], expected)
        places = np.array([point.xy for point in tracked]).reshape(-1, 2) / (48, 32)
        exact = {"binary": 0, "text": 1e-12}[form]
        np.testing.assert_allclose(track.places, places, rtol=exact, atol=0)
    assert lost > 3 and len(model.images[numbers[2]].get_observation_points2D()) == 0


def test_a_survey_does_not_parse_the_reconstruction_again(tiny_scene, monkeypatch):
    parser = RobustNerfDataParserConfig(data=tiny_scene.folder).setup()
    outputs = parser.get_dataparser_outputs("train")
    monkeypatch.delattr(pycolmap, "Reconstruction")
    assert observe(capture_of(outputs)).is_tracked.any()
