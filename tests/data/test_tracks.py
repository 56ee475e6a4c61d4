from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.robustnerf import RobustNerfDataParserConfig
from desplat_ns.data.tracks import METADATA_KEY, Tracks
from desplat_ns.errors import CaptureError


def tracks_of(folder: Path) -> Tracks:
    outputs = RobustNerfDataParserConfig(data=folder).setup().get_dataparser_outputs("train")
    return outputs.metadata[METADATA_KEY]


def test_photos_observe_the_points_that_they_show_and_nothing_hides(tiny_scene):
    observed = tracks_of(tiny_scene.folder).read([0, 3])
    shown = tiny_scene.points.is_seen[: tiny_scene.spec.num_views] & ~tiny_scene.is_occluded()
    for photo, seen in zip((0, 3), observed, strict=True):
        np.testing.assert_array_equal(np.sort(seen.points), np.flatnonzero(shown[photo]))
        assert ((seen.places > -0.1) & (seen.places < 1.1)).all()


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
    gone = Tracks(tmp_path / "gone", tracks.image_ids, tracks.point_ids)
    with pytest.raises(CaptureError, match="gone"):
        gone.read([0])
