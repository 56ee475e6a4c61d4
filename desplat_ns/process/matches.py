"""Matches between photos, verified by epipolar geometry, into the database. Runs in the worker.

Where the camera moves, the scene moves in the picture, and what stays is fixed to the camera: a
watermark, a dashboard, the photographer's stick. Matches at equal pixel positions tie photos that
share nothing. Letters in shapes: M matches.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Bool, Float

from desplat_ns.files.whole import write_whole
from desplat_ns.process.features import Progress
from desplat_ns.process.pairs import (
    ALL_PAIRS_UP_TO,
    LOOPS,
    Pair,
    all_pairs,
    sequential_pairs,
    similar_pairs,
    similarities,
)
from desplat_ns.process.recipes import Recipe

AT_ONCE = 50
"""Pairs in one call: few, so that progress is seen and a kill costs little."""
PAIRS_LOOKED_AT = 1000
"""For matches at equal positions."""
OFF_OF_SIDE = 0.003
"""Of the longer side: how far a match may be off its epipolar line, and how far apart positions may
be that count as equal. 5 pixels of 1600."""
LEAST_ERROR, MOST_ERROR = 1.5, 4.0
"""Pixels off the line. 4 is COLMAP's for photos of any size; in one of 480 pixels that ties what is
not the same, and focal lengths of ten tourists' photos came out at half of what they are."""
LEAST_TOLERANCE = 2.0
"""Pixels between equal positions, for small photos."""
SUSPICIOUS = 0.3
"""Share of all verified matches at equal positions from which on it is said, and they are left out.
"""

Pairing = Literal["exhaustive", "sequential", "similar"]


def match_photos(
    database: Path,
    pairing: Pairing | Literal["auto"],
    pairs_file: Path,
    recipe: Recipe,
    threads: int,
    progress: Progress,
) -> dict[str, Any]:
    """Match and verify pairs; those that are matched already are passed over.

    Where `SUSPICIOUS` many matches sit at equal pixel positions, all are verified again without
    those.

    Args:
        pairs_file: gets names of two copies and the number of their verified matches, for each
            pair that has any, as JSON.

    Returns:
        `pairing`: how pairs were chosen; `stationary`: as `summarise` says it; `left_out`: whether
        those matches were.
    """
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
    names = [image.name for image in images]
    if pairing == "auto":
        pairing = "exhaustive" if len(images) <= ALL_PAIRS_UP_TO else "similar"
    pairs = _chosen_pairs(database, images, pairing, recipe)
    _match(database, [(names[a], names[b]) for a, b in pairs], recipe, threads, progress)
    stationary = _stationary(database)
    left_out = stationary["share"] >= SUSPICIOUS
    if left_out:
        _verify_without_stationary(database, threads)
    write_whole(pairs_file, json.dumps(verified_pairs(database)).encode())
    return {"pairing": pairing, "stationary": stationary, "left_out": left_out}


def verified_pairs(database: Path) -> list[tuple[str, str, int]]:
    """Names of two photos and how many matches were verified, for pairs that have any."""
    with pycolmap.Database.open(database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        ids, counts = db.read_two_view_geometry_num_inliers()
    both = (pycolmap.pair_id_to_image_pair(pair) for pair in ids)
    return [(names[a], names[b], n) for (a, b), n in zip(both, counts, strict=True) if n > 0]


def _chosen_pairs(
    database: Path, images: Sequence[pycolmap.Image], pairing: Pairing, recipe: Recipe
) -> list[Pair]:
    if pairing == "exhaustive":
        return all_pairs(len(images))
    with pycolmap.Database.open(database) as db:
        likeness = similarities(_Descriptors(db, [image.image_id for image in images]))
    if pairing == "similar":
        return similar_pairs(likeness, recipe.neighbours)
    sequence = set(sequential_pairs(len(images)))
    return sorted(sequence.union(similar_pairs(likeness, LOOPS)))


class _Descriptors(Sequence[np.ndarray]):
    """Descriptors of photos, [F, 128] float32, each read when it is asked for: those of 2,000
    photos are 8 GB."""

    def __init__(self, database: pycolmap.Database, images: Sequence[int]):
        self._database, self._images = database, images

    def __len__(self) -> int:
        return len(self._images)

    def __getitem__(self, index: Any) -> np.ndarray:
        descriptors = self._database.read_descriptors(self._images[index]).data
        return np.asarray(descriptors, dtype=np.float32).reshape(-1, 128)


def _match(
    database: Path,
    pairs: Sequence[tuple[str, str]],
    recipe: Recipe,
    threads: int,
    progress: Progress,
) -> None:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = threads
    options.guided_matching = recipe.guided
    listed, verification = database.with_name("pairs.txt"), _verification(database)
    for start in range(0, len(pairs), AT_ONCE):
        progress(start, len(pairs))
        chunk = pairs[start : start + AT_ONCE]
        listed.write_text("".join(f"{a} {b}\n" for a, b in chunk), "utf8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, options, pairing, verification)
    progress(len(pairs), len(pairs))


def verification_error(longest_side: int) -> float:
    """Pixels that a match may be off its epipolar line, in photos of that size."""
    return min(MOST_ERROR, max(LEAST_ERROR, OFF_OF_SIDE * longest_side))


def tolerance_of(longest_side: int) -> float:
    """Pixels by which equal positions may differ."""
    return max(LEAST_TOLERANCE, OFF_OF_SIDE * longest_side)


def _longest_side(database: Path) -> int:
    with pycolmap.Database.open(database) as db:
        return max(max(camera.width, camera.height) for camera in db.read_all_cameras())


def _verification(database: Path) -> pycolmap.TwoViewGeometryOptions:
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = verification_error(_longest_side(database))
    options.ransac.random_seed = 0
    return options


def is_stationary(
    first: Float[np.ndarray, "M 2"], second: Float[np.ndarray, "M 2"], tolerance: float
) -> Bool[np.ndarray, " M"]:
    """Which matches are at the same place in both photos, to `tolerance` pixels."""
    return np.linalg.norm(first - second, axis=1) <= tolerance


def summarise(count: int, places: Float[np.ndarray, "_ 2"]) -> dict[str, Any]:
    """How many matches sit at equal positions, and where.

    Args:
        count: matches looked at.
        places: of those that are stationary, as shares of width and height.

    Returns:
        `share` of all; `box`: left, top, right, bottom of nine tenths of them, None without any.
    """
    if len(places) == 0:
        return {"share": 0.0, "box": None}
    box = np.quantile(places, [0.05, 0.95], axis=0).ravel().tolist()
    return {"share": len(places) / count, "box": box}


def _stationary(database: Path) -> dict[str, Any]:
    """Of verified matches, in an even choice of pairs."""
    with pycolmap.Database.open(database) as db:
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        camera_of = {i.image_id: cameras[i.camera_id] for i in db.read_all_images()}
        ids, counts = db.read_two_view_geometry_num_inliers()
        pairs = [pair for pair, count in zip(ids, counts, strict=True) if count > 0]
        total, places = 0, [np.zeros((0, 2))]
        for pair in pairs[:: max(1, len(pairs) // PAIRS_LOOKED_AT)]:
            a, b = pycolmap.pair_id_to_image_pair(pair)
            matches = db.read_two_view_geometry(a, b).inlier_matches
            first = db.read_keypoints(a)[matches[:, 0], :2].astype(float)
            second = db.read_keypoints(b)[matches[:, 1], :2].astype(float)
            size = camera_of[a].width, camera_of[a].height
            same = is_stationary(first, second, tolerance_of(max(size)))
            total += len(matches)
            places.append(first[same] / size)
    return summarise(total, np.concatenate(places))


def _verify_without_stationary(database: Path, threads: int) -> None:
    with pycolmap.Database.open(database) as db:
        db.clear_two_view_geometries()
    options = _verification(database)
    options.filter_stationary_matches = True
    options.stationary_matches_max_error = tolerance_of(_longest_side(database))
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = threads
    pycolmap.geometric_verification(database, verifier, two_view_geometry_options=options)
