"""Matches between photos, verified by epipolar geometry, into the database. Runs in the worker."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap

from desplat_ns.files.whole import write_whole
from desplat_ns.process.features import Progress
from desplat_ns.process.pairs import (
    ALL_PAIRS_UP_TO,
    LOOPS,
    Pair,
    all_pairs,
    sequential_pairs,
    similar_pairs,
)
from desplat_ns.process.recipes import Recipe, verification_error
from desplat_ns.process.similarity import similarities
from desplat_ns.process.stationary import (
    SUSPICIOUS,
    Stationary,
    is_stationary,
    summarise,
    tolerance_of,
)

AT_ONCE = 50
"""Pairs in one call: few, so that progress is seen and a kill costs little."""
PAIRS_LOOKED_AT = 1000
"""For matches at equal positions."""

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
        `pairing`: how pairs were chosen; `stationary`: share and box (see `stationary.Stationary`);
        `left_out`: whether those matches were.
    """
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
    names = [image.name for image in images]
    if pairing == "auto":
        pairing = "exhaustive" if len(images) <= ALL_PAIRS_UP_TO else "similar"
    pairs = _chosen_pairs(database, images, pairing, recipe)
    _match(database, [(names[a], names[b]) for a, b in pairs], recipe, threads, progress)
    found = _stationary(database)
    left_out = found.share >= SUSPICIOUS
    if left_out:
        _verify_without_stationary(database, threads)
    write_whole(pairs_file, json.dumps(verified_pairs(database)).encode())
    return {"pairing": pairing, "stationary": asdict(found), "left_out": left_out}


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
    likeness = similarities(_descriptors(database, images))
    if pairing == "similar":
        return similar_pairs(likeness, recipe.neighbours)
    sequence = set(sequential_pairs(len(images)))
    return sorted(sequence.union(similar_pairs(likeness, LOOPS)))


def _descriptors(database: Path, images: Sequence[pycolmap.Image]) -> list[np.ndarray]:
    with pycolmap.Database.open(database) as db:
        return [
            np.asarray(db.read_descriptors(image.image_id).data, dtype=np.float32).reshape(-1, 128)
            for image in images
        ]


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


def _verification(database: Path) -> pycolmap.TwoViewGeometryOptions:
    with pycolmap.Database.open(database) as db:
        sides = [max(camera.width, camera.height) for camera in db.read_all_cameras()]
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = verification_error(max(sides))
    options.ransac.random_seed = 0
    return options


def _stationary(database: Path) -> Stationary:
    """Of verified matches, in an even choice of pairs."""
    with pycolmap.Database.open(database) as db:
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        camera_of = {i.image_id: cameras[i.camera_id] for i in db.read_all_images()}
        ids, counts = db.read_two_view_geometry_num_inliers()
        pairs = [pair for pair, count in zip(ids, counts, strict=True) if count > 0]
        chosen = pairs[:: max(1, len(pairs) // PAIRS_LOOKED_AT)]
        total, places = 0, [np.zeros((0, 2))]
        for pair in chosen:
            a, b = pycolmap.pair_id_to_image_pair(pair)
            matches = db.read_two_view_geometry(a, b).inlier_matches
            first = db.read_keypoints(a)[matches[:, 0], :2].astype(float)
            second = db.read_keypoints(b)[matches[:, 1], :2].astype(float)
            size = camera_of[a].width, camera_of[a].height
            same = is_stationary(first, second, tolerance_of(*size))
            total += len(matches)
            places.append(first[same] / size)
    return summarise(total, np.concatenate(places))


def _verify_without_stationary(database: Path, threads: int) -> None:
    with pycolmap.Database.open(database) as db:
        db.clear_two_view_geometries()
        sides = [(camera.width, camera.height) for camera in db.read_all_cameras()]
    options = _verification(database)
    options.filter_stationary_matches = True
    options.stationary_matches_max_error = max(tolerance_of(*side) for side in sides)
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = threads
    pycolmap.geometric_verification(database, verifier, two_view_geometry_options=options)
