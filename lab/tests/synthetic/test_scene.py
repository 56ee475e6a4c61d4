from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desplat_ns.data.images import read_image
from desplat_ns.errors import ConfigError
from lab.synthetic import Frame, OccluderSpec, SceneSpec, make_scene, write_scene
from lab.synthetic.arrays import f32
from lab.synthetic.colmap_export import pycolmap

SMALL = replace(SceneSpec.tiny(), num_views=4, num_extras=1, supersample=1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(SceneSpec.tiny(), tmp_path_factory.mktemp("scene") / "yard")


def files(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def test_the_same_spec_gives_the_same_bytes_and_another_seed_gives_others(tmp_path):
    write_scene(SMALL, tmp_path / "a")
    write_scene(SMALL, tmp_path / "b")
    write_scene(replace(SMALL, seed=1), tmp_path / "c")
    a, b, c = (files(tmp_path / name) for name in "abc")
    assert a == b
    assert set(a) == set(c)
    pictures = [name for name in a if name.startswith("images")]
    assert all(a[name] != c[name] for name in [*pictures, "sparse/0/points3D.bin"])


def test_twins_are_identical_wherever_no_occluder_touches_a_pixel(scene):
    for clean, clutter in zip(scene.clean, scene.clutter, strict=True):
        untouched = clutter.coverage == 0
        assert untouched.mean() > 0.5
        np.testing.assert_array_equal(clean.image[untouched], clutter.image[untouched])
        np.testing.assert_array_equal(clean.camera.viewmat, clutter.camera.viewmat)


def test_pixels_at_least_half_covered_are_in_the_mask(scene):
    camera = scene.clean[0].camera
    coverage = f32([[0, 0.25, 0.5, 0.75, 1]])
    image = np.zeros((1, 5, 3), np.uint8)
    frame = Frame("clutter_0001", camera, image, np.ones_like(coverage), coverage)
    assert frame.mask.tolist() == [[False, False, True, True, True]]


def test_masks_cover_what_the_spec_asks_for_and_differ_from_view_to_view(scene):
    limits = scene.spec.occluders
    for i, frame in enumerate(scene.clutter):
        # Anti-aliased edges: the limits hold for pixel centres.
        assert limits.min_fraction - 0.02 < frame.mask.mean() < limits.max_fraction + 0.02
        changed = (frame.image != scene.clean[i].image).any(axis=2)
        assert changed[frame.coverage == 1].mean() > 0.9
        for other in scene.clutter[:i]:
            assert (frame.mask & other.mask).sum() < 0.7 * (frame.mask | other.mask).sum()


@pytest.mark.parametrize("seed", [0, 1])
def test_most_views_show_each_point_without_an_occluder(seed):
    scene = make_scene(SceneSpec(width=72, height=48, num_points=600, supersample=1, seed=seed))
    shown = scene.points.is_seen[:24].sum(axis=0)
    hidden = scene.is_occluded().sum(axis=0)
    assert (hidden <= shown / 2).mean() > 0.98
    assert hidden.mean() > 0.15 * shown.mean()
    assert scene.points.xyz.shape[1] == 600


def test_the_folder_holds_robustnerf_names_masks_and_the_spec(scene):
    folder = scene.folder
    names = sorted(path.stem for path in (folder / "images").glob("*.png"))
    assert names == sorted(f.name for f in scene.clean + scene.clutter + scene.extra)
    for frame in scene.clean + scene.clutter + scene.extra:
        np.testing.assert_array_equal(
            read_image(folder / "images" / f"{frame.name}.png"), frame.image
        )
    for frame in scene.clutter:
        mask = read_image(folder / "masks" / f"{frame.name}.png")
        np.testing.assert_array_equal(mask[..., 0], np.where(frame.mask, 255, 0))
    assert json.loads((folder / "scene.json").read_text())["num_views"] == 6


def test_the_reconstruction_agrees_with_the_truth(scene):
    read = pycolmap.Reconstruction(scene.folder / "sparse" / "0")
    frames = {f"{f.name}.png": f for f in scene.clean + scene.clutter + scene.extra}
    assert {image.name for image in read.images.values()} == set(frames)
    # Errors of two coordinates: their root mean square is sqrt(2) sigma.
    error = read.compute_mean_reprojection_error()
    assert 0.5 * scene.spec.pixel_noise < error < 2 * math.sqrt(2) * scene.spec.pixel_noise
    xyz = np.stack([point.xyz for _, point in sorted(read.points3D.items())], axis=1)
    spread = np.std(xyz - scene.points.xyz)
    assert spread == pytest.approx(scene.spec.point_noise, rel=0.2)
    for image in read.images.values():
        frame = frames[image.name]
        indices = [p.point3D_id - 1 for p in image.points2D]
        pixels, _ = frame.camera.project(scene.points.xyz[:, indices])
        columns, rows = pixels.astype(int)
        assert (frame.coverage[rows, columns] == 0).all()


@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_seed_gives_a_scene(seed):
    scene = make_scene(replace(SMALL, seed=seed))
    assert np.isfinite(scene.points.xyz).all()
    assert scene.points.xyz.shape[1] > 30


def test_low_walls_let_the_sky_in():
    scene = make_scene(replace(SMALL, wall_height=1.5))
    assert np.isinf(scene.extra[0].depth).mean() > 0.1
    assert np.isfinite(make_scene(SMALL).extra[0].depth).all()


def test_no_occluders_leave_twins_identical():
    calm = OccluderSpec(min_fraction=0.0, max_fraction=0.0)
    scene = make_scene(replace(SMALL, occluders=calm))
    for clean, clutter in zip(scene.clean, scene.clutter, strict=True):
        np.testing.assert_array_equal(clean.image, clutter.image)


def test_a_folder_with_pictures_is_left_alone(scene):
    before = files(scene.folder)
    with pytest.raises(ConfigError, match="already holds pictures"):
        write_scene(SMALL, scene.folder)
    assert files(scene.folder) == before
