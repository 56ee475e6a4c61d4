"""A generated capture agrees with its own truth."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desplat_ns.core.errors import ConfigError
from desplat_ns.data.images import read_image
from lab.synthetic import DaylightSpec, SceneSpec, make_scene, write_scene
from lab.synthetic.daylight import apply_light
from lab.synthetic.layouts import pycolmap
from lab.synthetic.render import to_uint8

SMALL = replace(SceneSpec.tiny(), num_views=4, num_extras=1, supersample=1)
LIT = replace(SMALL, num_views=6, wall_height=2.6, seed=2, daylight=DaylightSpec(), num_extras=3)


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


def test_the_yard_is_drawn_as_it_always_was(scene):
    """Another processor may round a pixel in a hundred to the next level, 0.01 in the mean; another
    order of random numbers changes far more."""
    means = [frame.image.mean() for frame in scene.clutter]
    first = [133.5171, 118.0766, 119.9718, 134.2574, 103.7797, 104.6864]
    np.testing.assert_allclose(means, first, atol=0.01)
    centre = [-0.0688054, 1.2484218, 1.1486703]
    np.testing.assert_allclose(scene.points.xyz.mean(axis=1), centre, atol=1e-5)


def test_twins_are_identical_wherever_no_occluder_touches_a_pixel(scene):
    limits = scene.spec.occluders
    for clean, clutter in zip(scene.clean, scene.clutter, strict=True):
        untouched = clutter.coverage == 0
        np.testing.assert_array_equal(clean.image[untouched], clutter.image[untouched])
        np.testing.assert_array_equal(clean.camera.viewmat, clutter.camera.viewmat)
        # Anti-aliased edges: the limits hold for pixel centres.
        assert limits.min_fraction - 0.02 < clutter.mask.mean() < limits.max_fraction + 0.02
        changed = (clutter.image != clean.image).any(axis=2)
        assert changed[clutter.coverage == 1].mean() > 0.9


def test_most_views_show_each_point_without_an_occluder():
    scene = make_scene(SceneSpec(width=72, height=48, num_points=600, supersample=1))
    shown = scene.points.is_seen[:24].sum(axis=0)
    hidden = scene.is_occluded().sum(axis=0)
    assert (hidden <= shown / 2).mean() > 0.98
    assert hidden.mean() > 0.15 * shown.mean()


def test_the_folder_holds_robustnerf_names_and_masks(scene):
    folder, frames = scene.folder, scene.clean + scene.clutter + scene.extra
    assert {path.stem for path in (folder / "images").iterdir()} == {f.name for f in frames}
    for frame in frames:
        photo = read_image(folder / "images" / f"{frame.name}.png")
        np.testing.assert_array_equal(photo, frame.image)
    for frame in scene.clutter:
        mask = read_image(folder / "masks" / f"{frame.name}.png")
        np.testing.assert_array_equal(mask[..., 0], np.where(frame.mask, 255, 0))
    before = files(folder)
    with pytest.raises(ConfigError, match="already holds pictures"):
        write_scene(SMALL, folder)
    assert files(folder) == before


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


@pytest.mark.parametrize("place", ["facade", "table"])
def test_other_places_have_points_and_occluders(place):
    spec = {"facade": SceneSpec.facade(6), "table": SceneSpec.table_top(6)}[place]
    scene = make_scene(replace(spec, num_extras=2, width=96, height=64, num_points=400))
    assert scene.points.xyz.shape[1] > 100
    assert all(frame.mask.mean() > 0.05 for frame in scene.clutter)


def test_daylight_changes_colours_only_and_the_sky_is_the_photos_own():
    lit, off = make_scene(LIT), make_scene(replace(LIT, daylight=None))
    for frame, other in zip(lit.clutter + lit.extra, off.clutter + off.extra, strict=True):
        np.testing.assert_array_equal(frame.camera.viewmat, other.camera.viewmat)
        np.testing.assert_array_equal(frame.coverage, other.coverage)
        assert (frame.image != other.image).any(axis=2).mean() > 0.8
        assert frame.daylight is not None and frame.daylight.sky is not None
        is_sky = np.isinf(frame.depth) & (frame.coverage == 0)
        assert 0.02 < is_sky.mean() < 0.5
        colors = frame.daylight.sky.toward(frame.camera.rays(1)).transpose(1, 2, 0)
        expected = to_uint8(apply_light(colors, frame.daylight.light))
        np.testing.assert_array_equal(frame.image[is_sky], expected[is_sky])
    np.testing.assert_array_equal(lit.points.xyz, off.points.xyz)
    assert len({frame.daylight for frame in lit.clean}) == 6
    for clean, clutter in zip(lit.clean, lit.clutter, strict=True):
        assert clean.daylight == clutter.daylight


def test_a_sun_of_its_own_moves_shadows_and_no_factor_undoes_that():
    same = DaylightSpec(strength=0.0, sky=False)
    plain, sunny = (
        make_scene(replace(LIT, daylight=spec)).clean for spec in (same, replace(same, sun=90.0))
    )
    changed = [(a.image != b.image).any(axis=2).mean() for a, b in zip(plain, sunny, strict=True)]
    assert np.mean(changed) > 0.2
