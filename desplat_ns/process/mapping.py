"""Poses and points from verified matches, incrementally. Runs in the worker."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap

from desplat_ns.process.features import Progress
from desplat_ns.process.recipes import Recipe
from desplat_ns.process.request import MIN_PHOTOS

SEED = 1
"""Of COLMAP's random numbers: the same photos give the same poses on one thread."""


def map_photos(
    database: Path, photos: Path, models: Path, recipe: Recipe, threads: int, progress: Progress
) -> list[dict[str, Any]]:
    """Find poses; writes each model to a folder of its own in `models`.

    Returns:
        For each model, the one with most photos first: `folder`, the copies' names as `photos`,
        `points`, `observations`, and the mean reprojection `error` in pixels.
    """
    shutil.rmtree(models, ignore_errors=True)
    models.mkdir(parents=True)
    with pycolmap.Database.open(database) as db:
        total = db.num_images()
    placed = 0

    def one_more() -> None:
        nonlocal placed
        placed += 1
        progress(min(placed, total), total)

    progress(0, total)
    mapped = pycolmap.incremental_mapping(
        database,
        photos,
        models,
        _options(recipe, threads),
        initial_image_pair_callback=one_more,
        next_image_callback=one_more,
    )
    records = [_finish(model, models / str(index), recipe) for index, model in mapped.items()]
    return sorted(records, key=lambda model: (-len(model["photos"]), model["error"]))


def _options(recipe: Recipe, threads: int) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = threads
    options.random_seed = SEED
    options.min_model_size = MIN_PHOTOS
    options.mapper.abs_pose_min_num_inliers = recipe.pose_inliers
    return options


def _finish(model: pycolmap.Reconstruction, folder: Path, recipe: Recipe) -> dict[str, Any]:
    """Filter and adjust once more where the recipe says so; write the model and describe it."""
    if recipe.filter_error is not None and recipe.filter_angle is not None:
        pycolmap.ObservationManager(model).filter_all_points3D(
            recipe.filter_error, recipe.filter_angle
        )
        pycolmap.bundle_adjustment(model)
        model.update_point_3d_errors()
        folder.mkdir(exist_ok=True)
        model.write(folder)
    return {
        "folder": folder.name,
        "photos": sorted(model.image(i).name for i in model.reg_image_ids()),
        "points": model.num_points3D(),
        "observations": model.compute_num_observations(),
        "error": float(np.nan_to_num(model.compute_mean_reprojection_error())),
    }
