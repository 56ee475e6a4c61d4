"""Which photos are compared, and what ties them: on the generated yard, by pycolmap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
import pytest

from desplat_ns.process import matches, pairs
from desplat_ns.process.mapping import map_photos
from desplat_ns.process.matches import (
    SUSPICIOUS,
    Pairing,
    is_stationary,
    match_photos,
    tolerance_of,
    verified_pairs,
)
from desplat_ns.process.preparation import prepare_masks
from desplat_ns.process.recipes import PLAIN
from tests.helpers.yard import (
    CLOSE,
    EDGE,
    SIZE,
    Features,
    Yard,
    copied,
    features_of,
    places_of,
    silent,
    write_mask_of_the_mark,
)

FEW = replace(PLAIN, neighbours=3)
"""With a dozen photos: each is compared with a quarter of the others."""
EVERY_OTHER = range(0, 12, 2)
"""The views that `marked` shows."""


def match(mine: Features, pairing: Pairing) -> dict[str, Any]:
    """What `match_photos` says of photos whose features are known."""
    return match_photos(mine.database, pairing, mine.database.with_name("pairs"), FEW, 1, silent)


def numbers(a: str, b: str) -> tuple[int, int]:
    """A pair of copies as the places of the photos in their order."""
    first, second = (int(Path(name).stem) - 1 for name in sorted((a, b)))
    return first, second


def tied(mine: Features) -> set[tuple[int, int]]:
    """Pairs that have verified matches."""
    return {numbers(a, b) for a, b, _ in verified_pairs(mine.database)}


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
    best = map_photos(mine.database, mine.copies, folder, PLAIN, 1, silent)[0]
    views = {photo.copy: view for photo, view in zip(mine.photos, order, strict=True)}
    return yard.farthest(folder / best["folder"], views)


@pytest.mark.slow
@pytest.mark.parametrize("pairing", ["exhaustive", "similar", "sequential"])
def test_each_pairing_gives_every_photo_its_place(
    pairing: Pairing, plain: Features, yard: Yard, tmp_path: Path
):
    mine = plain.again(tmp_path)
    assert match(mine, pairing)["pairing"] == pairing
    assert worst_pose(mine, yard, range(len(yard.pictures))) < CLOSE


def test_photos_that_look_alike_are_compared_and_others_are_not(plain: Features, tmp_path: Path):
    """The camera goes around: the most alike are next to each other."""
    mine = plain.again(tmp_path)
    match(mine, "similar")
    last = len(mine.photos) - 1
    assert {(i, i + 1) for i in range(last)} <= compared(mine)
    assert all(b - a < last / 2 for a, b in compared(mine))


@pytest.mark.slow
def test_what_a_video_shows_again_at_its_end_is_compared_with_its_beginning(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """There by every other view, back by those between: the last is next to the first."""
    monkeypatch.setattr(pairs, "OVERLAP", 1)
    monkeypatch.setattr(matches, "LOOPS", 2)
    order = [*EVERY_OTHER, *(view + 1 for view in reversed(EVERY_OTHER))]
    photos = copied(yard.write(tmp_path / "photos", order), tmp_path / "copies")
    mine = features_of(photos, tmp_path / "copies", tmp_path / "database.db")
    match(mine, "sequential")
    last = len(order) - 1
    assert (0, last) not in pairs.sequential_pairs(len(order))
    assert {(0, last), *((i, i + 1) for i in range(last))} <= tied(mine)


def still_and_all(mine: Features) -> tuple[int, int]:
    """Verified matches at equal places where the mark is, and all verified matches."""
    still, every = 0, 0
    places = places_of(mine.database)
    with pycolmap.Database.open(mine.database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        for pair in db.read_two_view_geometry_num_inliers()[0]:
            a, b = pycolmap.pair_id_to_image_pair(pair)
            of_a, of_b = db.read_two_view_geometry(a, b).inlier_matches.T
            first, second = places[names[a]][of_a], places[names[b]][of_b]
            same = is_stationary(first, second, tolerance_of(max(SIZE)))
            still, every = still + int((same & (first[:, 1] > EDGE)).sum()), every + len(of_a)
    return still, every


@pytest.mark.slow
def test_what_stands_still_in_all_photos_does_not_tie_them(
    marked: Features, yard: Yard, tmp_path: Path
):
    mine = marked.again(tmp_path)
    said = match(mine, "exhaustive")
    assert said["left_out"] and said["stationary"]["share"] >= SUSPICIOUS
    _, top, _, _ = said["stationary"]["box"]
    assert top * SIZE[1] > EDGE - tolerance_of(max(SIZE))
    still, every = still_and_all(mine)
    assert still == 0 and every > 0
    assert worst_pose(mine, yard, EVERY_OTHER) < CLOSE


@pytest.mark.slow
def test_where_a_mask_covers_what_stands_still_nothing_has_to_be_left_out(
    marked: Features, yard: Yard, tmp_path: Path
):
    mask = write_mask_of_the_mark(tmp_path / "mask.png")
    prepare_masks(mask, marked.photos, tmp_path / "masks")
    masks, database = tmp_path / "masks", tmp_path / "database.db"
    mine = features_of(marked.photos, marked.copies, database, masks)
    assert not match(mine, "exhaustive")["left_out"]
    assert worst_pose(mine, yard, EVERY_OTHER) < CLOSE


def test_photos_read_one_by_one_are_as_alike_as_those_read_together(plain: Features):
    with pycolmap.Database.open(plain.database) as db:
        ids = [image.image_id for image in db.read_all_images()]
        together = [db.read_descriptors(number).data.astype(np.float32) for number in ids]
        one_by_one = matches._Descriptors(db, ids)
        assert {len(descriptors) for descriptors in together} != {0}
        np.testing.assert_array_equal(pairs.similarities(one_by_one), pairs.similarities(together))
