"""Which photos are compared, what ties them and where they are: on the generated yard, by
pycolmap."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from desplat_ns.tools.process import reconstruction
from desplat_ns.tools.process.photos import FILM_DIAGONAL, group_by_camera
from desplat_ns.tools.process.reconstruction import (
    LEAST_TOLERANCE,
    PLAIN,
    enter_photos,
    feature_counts,
    map_photos,
    match_photos,
    verified_pairs,
)
from tests.helpers.yard import CLOSE, EDGE, Features, Yard, places_of

FEW = replace(PLAIN, neighbours=3)
"""With a dozen photos: each is compared with a quarter of the others."""
EVERY_OTHER = range(0, 12, 2)
"""The views that `marked` shows."""


def numbers(a: str, b: str) -> tuple[int, int]:
    """A pair of copies as the places of the photos in their order."""
    first, second = (int(Path(name).stem) - 1 for name in sorted((a, b)))
    return first, second


def compared(mine: Features) -> set[tuple[int, int]]:
    """Pairs that were looked at, whether anything was found or not."""
    with pycolmap.Database.open(mine.database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        ids, _ = db.read_all_matches()
    both = map(pycolmap.pair_id_to_image_pair, ids)
    return {numbers(names[a], names[b]) for a, b in both}


def worst_pose(mine: Features, yard: Yard, order: Sequence[int]) -> float:
    """Pixels by which the worst camera is off, of photos that show those views; all have poses."""
    folder = mine.database.with_name("models")
    best = map_photos(mine.database, mine.copies, folder, PLAIN)[0]
    views = {photo.copy: view for photo, view in zip(mine.photos, order, strict=True)}
    return yard.farthest(best.folder, views)


def test_many_photos_are_compared_with_those_that_look_alike_which_gives_each_its_place(
    plain: Features, yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The camera goes around: the most alike are next to each other."""
    mine = plain.again(tmp_path)
    monkeypatch.setattr(reconstruction, "ALL_PAIRS_UP_TO", 5)
    match_photos(mine.database, False, FEW)
    last = len(mine.photos) - 1
    assert {(i, i + 1) for i in range(last)} <= compared(mine)
    assert all(b - a < last / 2 for a, b in compared(mine))
    assert worst_pose(mine, yard, range(len(yard.pictures))) < CLOSE


def test_what_a_video_shows_again_at_its_end_is_compared_with_its_beginning(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """There by every other view, back by those between: the last is next to the first."""
    monkeypatch.setattr(reconstruction, "OVERLAP", 1)
    monkeypatch.setattr(reconstruction, "LOOPS", 2)
    order = [*EVERY_OTHER, *(view + 1 for view in reversed(EVERY_OTHER))]
    mine = yard.features(tmp_path, order)
    match_photos(mine.database, True, FEW)
    last = len(order) - 1
    assert (0, last) not in reconstruction.sequential_pairs(len(order))
    tied = {numbers(a, b) for a, b, _ in verified_pairs(mine.database)[1]}
    assert {(0, last), *((i, i + 1) for i in range(last))} <= tied


def test_another_focal_length_leaves_features_and_matches_and_verifies_anew(
    plain: Features, tmp_path: Path
):
    mine = plain.again(tmp_path)
    match_photos(mine.database, False, PLAIN)
    at_500 = 500 * FILM_DIAGONAL / np.hypot(320, 240)
    known = [replace(photo, focal_35mm=at_500) for photo in mine.photos]
    for photos, starts, matches in ((mine.photos, 384.0, True), (known, 500.0, False)):
        enter_photos(mine.database, mine.copies, group_by_camera(photos, "auto"), "auto")
        with pycolmap.Database.open(mine.database) as db:
            (camera,) = db.read_all_cameras()
            assert camera.mean_focal_length() == pytest.approx(starts)
            assert (db.num_verified_image_pairs() > 0) == matches
            assert db.num_matched_image_pairs() > 0
    assert all(feature_counts(mine.database).values())


def verified_at_equal_places(mine: Features) -> tuple[int, int]:
    """Verified matches at equal places where the mark is, and all verified matches."""
    still, every = 0, 0
    places = places_of(mine.database)
    with pycolmap.Database.open(mine.database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        for pair in db.read_two_view_geometry_num_inliers()[0]:
            a, b = pycolmap.pair_id_to_image_pair(pair)
            of_a, of_b = db.read_two_view_geometry(a, b).inlier_matches.T
            first, second = places[names[a]][of_a], places[names[b]][of_b]
            same = np.linalg.norm(first - second, axis=1) <= LEAST_TOLERANCE
            still, every = still + int((same & (first[:, 1] > EDGE)).sum()), every + len(of_a)
    return still, every


def test_what_stands_still_in_all_photos_does_not_tie_them(
    marked: Features, yard: Yard, tmp_path: Path
):
    mine = marked.again(tmp_path)
    match_photos(mine.database, False, FEW)
    still, every = verified_at_equal_places(mine)
    assert still == 0 and every > 0
    assert worst_pose(mine, yard, EVERY_OTHER) < CLOSE


@pytest.mark.parametrize("calls", [1, 2])
def test_features_and_matches_that_were_cut_off_go_on_where_they_stopped(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int
):
    """Cut off after the first call of pycolmap, and after the second."""
    left = [calls]

    def cut_off(name: str) -> None:
        done = getattr(pycolmap, name)

        def noted(*places: Any, **options: Any) -> None:
            if left[0] == 0:
                raise KeyboardInterrupt
            left[0] -= 1
            done(*places, **options)

        monkeypatch.setattr(reconstruction.pycolmap, name, noted)

    cut_off("extract_features")
    with pytest.raises(KeyboardInterrupt):
        yard.features(tmp_path, range(5))
    left[0] = 99
    mine = yard.features(tmp_path, range(5))
    counts = feature_counts(mine.database)
    assert list(counts) == [photo.copy for photo in mine.photos] and all(counts.values())
    cut_off("match_image_pairs")
    left[0] = 1
    with pytest.raises(KeyboardInterrupt):
        match_photos(mine.database, False, PLAIN)
    assert len(before := compared(mine)) == 8, "a call's pairs"
    left[0] = 99
    match_photos(mine.database, False, PLAIN)
    assert before < compared(mine) and len(compared(mine)) == 10
