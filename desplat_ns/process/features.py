"""SIFT features of all photos, into COLMAP's database. Runs in the worker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap

from desplat_ns.process.cameras import Camera
from desplat_ns.process.recipes import Recipe

Progress = Callable[[int, int], None]
"""Called with what is done and what there is to do."""

AT_ONCE = 2
"""Photos of each thread in one call: few, so that progress is seen and a kill costs little."""


def find_features(
    database: Path,
    photos: Path,
    cameras: Sequence[Camera],
    masks: Path | None,
    recipe: Recipe,
    threads: int,
    progress: Progress,
) -> dict[str, int]:
    """Enter cameras, photos and their features; photos that have them already are passed over.

    Args:
        photos: folder of the copies.
        masks: folder with COPY.png, or None.

    Returns:
        The number of features of each copy.
    """
    for camera in cameras:
        _enter(database, photos, camera)
    reader = pycolmap.ImageReaderOptions()
    if masks is not None:
        reader.mask_path = masks
    options = _options(recipe, threads)
    counts = feature_counts(database)
    missing = [name for name, count in counts.items() if count is None]
    step = AT_ONCE * threads
    for start in range(0, len(missing), step):
        progress(len(counts) - len(missing) + start, len(counts))
        names = missing[start : start + step]
        pycolmap.extract_features(
            database, photos, names, reader_options=reader, extraction_options=options
        )
    progress(len(counts), len(counts))
    return {name: count or 0 for name, count in feature_counts(database).items()}


def feature_counts(database: Path) -> dict[str, int | None]:
    """Features of each copy; None where they were not looked for yet."""
    with pycolmap.Database.open(database) as db:
        return {
            image.name: db.num_keypoints_for_image(image.image_id)
            if db.exists_keypoints(image.image_id)
            else None
            for image in sorted(db.read_all_images(), key=lambda image: image.name)
        }


def _enter(database: Path, photos: Path, camera: Camera) -> None:
    """The camera and its photos, with the focal length to start from."""
    with pycolmap.Database.open(database) as db:
        known = {image.name for image in db.read_all_images()}
    if known.issuperset(camera.copies):
        return
    options = pycolmap.ImageReaderOptions(camera_model=camera.model)
    pycolmap.import_images(
        database, photos, pycolmap.CameraMode.SINGLE, list(camera.copies), options
    )
    with pycolmap.Database.open(database) as db:
        image = db.read_image_with_name(camera.copies[0])
        assert image is not None, "it was entered just now"
        entered = db.read_camera(image.camera_id)
        params = np.array(entered.params)
        params[list(entered.focal_length_idxs())] = camera.focal
        entered.params = params.tolist()
        entered.has_prior_focal_length = camera.focal_is_known
        db.update_camera(entered)


def _options(recipe: Recipe, threads: int) -> pycolmap.FeatureExtractionOptions:
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads
    options.max_image_size = recipe.longest_side or -1
    options.sift.max_num_features = recipe.most_features
    options.sift.peak_threshold = recipe.peak_threshold
    options.sift.domain_size_pooling = recipe.domain_size_pooling
    options.sift.estimate_affine_shape = recipe.affine_shape
    return options
