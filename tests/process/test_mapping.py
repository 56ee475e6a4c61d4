"""What the thorough recipe takes out of a model at the end, on the generated yard."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pycolmap
import pytest

from desplat_ns.process.mapping import map_photos
from desplat_ns.process.matches import match_photos
from desplat_ns.process.recipes import PLAIN
from tests.helpers.yard import Features, silent

ERROR, ANGLE = 1.0, 10.0
"""Pixels and degrees: stricter than the thorough recipe, so that the yard's points fall short."""
STRICT = replace(PLAIN, filter_error=ERROR, filter_angle=ANGLE)

pytestmark = pytest.mark.slow  # photos are matched and mapped


class Models(NamedTuple):
    """The same photos with and without the filter."""

    plain: pycolmap.Reconstruction
    strict: pycolmap.Reconstruction


@pytest.fixture(scope="module")
def models(plain: Features, tmp_path_factory: pytest.TempPathFactory) -> Models:
    """One thread and one seed: up to the filter both are the same."""
    mine = plain.again(tmp_path_factory.mktemp("models"))
    pairs = mine.database.with_name("pairs")
    match_photos(mine.database, "exhaustive", pairs, PLAIN, 1, silent)
    read = []
    for name, recipe in (("plain", PLAIN), ("strict", STRICT)):
        folder = mine.database.with_name(name)
        best = map_photos(mine.database, mine.copies, folder, recipe, 1, silent)[0]
        read.append(pycolmap.Reconstruction(folder / best["folder"]))
    return Models(*read)


def widest_angle(model: pycolmap.Reconstruction, point: pycolmap.Point3D) -> float:
    """Degrees between those rays to a point that are farthest apart."""
    images = (model.image(element.image_id) for element in point.track.elements)
    rays = np.stack([image.projection_center() - point.xyz for image in images])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1).min())))


def errors(
    model: pycolmap.Reconstruction, which: pycolmap.Reconstruction
) -> dict[tuple[int, int], float]:
    """Pixels by which `model` is off at the observations that `which` has, by photo and feature."""
    off = {}
    for number, point in which.points3D.items():
        for element in point.track.elements:
            image = model.image(element.image_id)
            place = image.project_point(model.point3D(number).xyz)
            assert place is not None
            observed = image.point2D(element.point2D_idx).xy
            off[element.image_id, element.point2D_idx] = float(np.linalg.norm(place - observed))
    return off


def test_points_whose_rays_are_nearly_parallel_are_gone(models: Models):
    flat = {i for i, p in models.plain.points3D.items() if widest_angle(models.plain, p) < ANGLE}
    assert flat and models.strict.num_points3D() > 0
    assert flat.isdisjoint(models.strict.points3D)


def test_observations_that_were_far_off_are_gone(models: Models):
    assert max(errors(models.plain, models.plain).values()) > ERROR
    assert max(errors(models.plain, models.strict).values()) <= ERROR


def test_what_is_left_fits_better_than_before(models: Models):
    """The adjustment lessens the sum of squares over just these observations."""
    before, after = (np.array([*errors(m, models.strict).values()]) for m in models)
    assert (after**2).sum() < (before**2).sum()
