"""Pairs, cameras, frames, matches at equal places, reasons: by hand."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest

from desplat_ns.process.attempts import left_out
from desplat_ns.process.cameras import group_by_camera
from desplat_ns.process.matches import AT_ONCE, is_stationary, summarise, verification_error
from desplat_ns.process.pairs import (
    TILE,
    all_pairs,
    sequential_pairs,
    similar_pairs,
    similarities,
)
from desplat_ns.process.photos import Photo, numbered
from desplat_ns.process.video import Frame, choose


def photo(number: int, **changes) -> Photo:
    fields = {"width": 40, "height": 30, "sharpness": 100.0, **changes}
    return Photo(f"{number}.png", f"{number}.jpg", f"{number:05d}.jpg", **fields)


def test_names_that_differ_by_their_ending_do_not_meet():
    assert [named.name for named in numbered(["a.jpg", "a.png", "b/a.jpg"])] == [
        "a.jpg", "a_png.jpg", "b/a.jpg",
    ]  # fmt: skip


def test_all_pairs_are_each_there_once():
    assert sorted(all_pairs(120)) == list(combinations(range(120), 2))


@pytest.mark.parametrize("count", [50, 120, 200])
def test_pairs_that_are_matched_together_share_their_photos(count: int):
    """A call reads the features of each of its photos once: of some twenty, where pairs row by row
    would take one more photo than there are pairs."""
    pairs = all_pairs(count)
    calls = [pairs[start : start + AT_ONCE] for start in range(0, len(pairs), AT_ONCE)]
    photos = [len({photo for pair in call for photo in pair}) for call in calls]
    assert max(photos) <= 5 * TILE
    assert sum(photos) / len(calls) <= 3 * TILE


def test_frames_of_a_video_are_paired_with_neighbours_and_at_doubled_distances():
    with_first = [b for a, b in sequential_pairs(100) if a == 0]
    assert with_first == [*range(1, 11), 20, 40, 80]


def test_photos_are_paired_with_those_that_look_alike():
    rng = np.random.default_rng(0)
    kinds = rng.normal(size=(2, 200, 128)).astype(np.float32) * 10
    noise = rng.normal(size=(6, 200, 128)).astype(np.float32)
    likeness = similarities([kinds[i % 2] + noise[i] for i in range(6)])
    assert similar_pairs(likeness, 2) == [(0, 2), (0, 4), (1, 3), (1, 5), (2, 4), (3, 5)]


class OneByOne(Sequence[np.ndarray]):
    """Descriptors that are made anew whenever they are asked for, and counted while they live."""

    def __init__(self, all_of_them: Sequence[np.ndarray]):
        self.all, self.alive, self.most = all_of_them, 0, 0

    def __len__(self) -> int:
        return len(self.all)

    def __getitem__(self, index):
        made = self.all[index].copy()
        weakref.finalize(made, self._gone)
        self.alive += 1
        self.most = max(self.most, self.alive)
        return made

    def _gone(self) -> None:
        self.alive -= 1


def test_descriptors_of_two_photos_at_most_are_in_memory_together():
    rng = np.random.default_rng(0)
    descriptors = [rng.normal(size=(50, 128)).astype(np.float32) for _ in range(20)]
    streamed = OneByOne(descriptors)
    np.testing.assert_array_equal(similarities(streamed), similarities(descriptors))
    assert streamed.most <= 2


def test_photos_without_features_are_like_no_other():
    likeness = similarities([np.zeros((0, 128), np.float32), np.ones((3, 128), np.float32)])
    assert likeness[0].tolist() == [0, 0]


def test_photos_of_one_size_share_a_camera_unless_exif_says_otherwise():
    photos = [*(photo(i) for i in range(12)), photo(12, camera="A 5.0", focal=50.0)]
    cam, other = group_by_camera(photos, "auto", "auto")
    assert (cam.model, len(cam.copies), cam.focal, cam.focal_is_known) == ("RADIAL", 12, 48, False)
    assert (other.model, other.focal, other.focal_is_known) == ("SIMPLE_PINHOLE", 50.0, True)


def test_digital_zoom_makes_a_camera_of_its_own():
    """Lens and size stay; the focal length as on 35 mm film tells."""
    photos = [photo(i, camera="Maker X1 4.2", focal=(50.0, 75.0)[i % 2]) for i in range(4)]
    cameras = group_by_camera(photos, "auto", "auto")
    assert [(camera.focal, camera.copies) for camera in cameras] == [
        (50.0, ("00000.jpg", "00002.jpg")),
        (75.0, ("00001.jpg", "00003.jpg")),
    ]


def test_photos_of_many_sizes_have_a_camera_each():
    photos = [photo(i, width=40 + i // 2) for i in range(6)]
    assert len(group_by_camera(photos, "auto", "auto")) == 6
    assert len(group_by_camera(photos, "one", "auto")) == 3


def test_matches_at_equal_places_are_counted_and_placed():
    first = np.array([[10.0, 90], [12, 92], [50, 50]])
    same = is_stationary(first, first + np.array([[0.0, 1], [1, 0], [30, 0]]), 2.0)
    assert same.tolist() == [True, True, False]
    summary = summarise(3, first[same] / 100)
    assert summary["share"] == pytest.approx(2 / 3)
    assert summary["box"][0] >= 0.1 and summary["box"][3] <= 0.92


def test_the_sharpest_frame_of_each_even_part_of_the_way_is_taken():
    way = [0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4]
    frames = [
        Frame(i, s, d)
        for i, (s, d) in enumerate(zip([1.0, 5.0, 2.0, 3.0, 9.0, 1.0, 7.0], way, strict=True))
    ]
    assert [frame.index for frame in choose(frames, 2)] == [1, 4]
    assert len(choose([Frame(i, 1.0, 0.0) for i in range(9)], 5)) == 1
    assert choose([], 5) == []


def test_a_match_may_be_off_by_more_in_larger_photos_up_to_colmaps_bound():
    assert [verification_error(side) for side in (100, 1000, 5000)] == [1.5, 3.0, 4.0]


def test_each_photo_that_is_left_out_has_its_reason():
    photos = [photo(i) for i in range(4)]
    photos += [photo(4, sharpness=5.0), photo(5), photo(6), photo(7)]
    features = {photo.copy: 1000 for photo in photos} | {"00005.jpg": 20}
    pairs = [("00004.jpg", "00001.jpg", 17), ("00000.jpg", "00006.jpg", 400)]
    models = [[f"{i:05d}.jpg" for i in range(4)], ["00007.jpg"]]
    left = left_out(photos, models, features, pairs, 30)
    reasons = {entry["source"]: entry["reason"] for entry in left}
    assert list(reasons) == ["4.png", "5.png", "6.png", "7.png"]
    assert reasons["4.png"].startswith("blurred") and "17 at most, with 1.png" in reasons["4.png"]
    assert reasons["5.png"].startswith("bare (20 features") and "no matches" in reasons["5.png"]
    assert reasons["6.png"] == "400 matches with 0.png, but no pose that agrees with the others"
    assert reasons["7.png"].startswith("in another model of 1 photos")
