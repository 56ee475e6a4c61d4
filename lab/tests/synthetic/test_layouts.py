from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.colmap_model import read_reconstruction
from desplat_ns.data.images import read_image
from desplat_ns.errors import ConfigError
from lab.synthetic import SceneSpec, write_scene
from lab.synthetic.colmap_export import pycolmap

SMALL = replace(
    SceneSpec.tourism(),
    num_views=6,
    num_extras=3,
    width=64,
    height=48,
    other_sizes=((48, 64), (40, 40)),
    num_points=400,
)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(SMALL, tmp_path_factory.mktemp("scene") / "square")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_folder_is_arranged_as_photo_tourism(scene):
    folder = scene.folder
    training = [f"photo_{number:04d}.png" for number in range(1, 7)]
    test = [f"photo_{number:04d}.png" for number in range(7, 10)]
    assert names(folder) == [
        *("clean", "dense", "light.json", "masks", "scene.json", "unlit", "yard.tsv")
    ]
    assert names(folder / "dense") == ["images", "sparse"]
    assert names(folder / "dense" / "images") == training + test
    assert {"cameras.bin", "images.bin", "points3D.bin"} <= set(names(folder / "dense" / "sparse"))
    assert names(folder / "masks") == names(folder / "clean") == training
    assert names(folder / "unlit") == test


def test_the_split_file_gives_the_ids_of_the_reconstruction(scene):
    with (scene.folder / "yard.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    assert list(rows[0]) == ["filename", "id", "split", "dataset"]
    model = pycolmap.Reconstruction(scene.folder / "dense" / "sparse")
    assert {row["filename"]: int(row["id"]) for row in rows} == {
        image.name: image_id for image_id, image in model.images.items()
    }
    splits = {row["filename"]: row["split"] for row in rows}
    assert {n for n, s in splits.items() if s == "train"} == {
        f"{f.name}.png" for f in scene.clutter
    }
    assert {n for n, s in splits.items() if s == "test"} == {f"{f.name}.png" for f in scene.extra}
    assert {row["dataset"] for row in rows} == {"yard"}


def test_pictures_on_disk_are_the_scene_and_its_truth(scene):
    folder = scene.folder
    for frame in scene.clutter + scene.extra:
        np.testing.assert_array_equal(
            read_image(folder / "dense" / "images" / f"{frame.name}.png"), frame.image
        )
    for clean, clutter in zip(scene.clean, scene.clutter, strict=True):
        assert clean.name == clutter.name
        np.testing.assert_array_equal(
            read_image(folder / "clean" / f"{clean.name}.png"), clean.image
        )
        mask = read_image(folder / "masks" / f"{clutter.name}.png")[..., 0]
        np.testing.assert_array_equal(mask, np.where(clutter.mask, 255, 0))
        assert 0.05 < clutter.mask.mean() < 0.6
        changed = (clean.image != clutter.image).any(axis=2)
        assert changed[clutter.coverage == 1].mean() > 0.9
        assert not changed[clutter.coverage == 0].any()
    for frame in scene.unlit:
        np.testing.assert_array_equal(
            read_image(folder / "unlit" / f"{frame.name}.png"), frame.image
        )


def test_photos_of_every_size_agree_with_their_cameras_in_the_reconstruction(scene):
    model = pycolmap.Reconstruction(scene.folder / "dense" / "sparse")
    assert model.num_cameras() == 3
    frames = {f"{f.name}.png": f for f in scene.clutter + scene.extra}
    for image in model.images.values():
        frame, camera = frames[image.name], model.cameras[image.camera_id]
        assert frame.image.shape == (camera.height, camera.width, 3)
        assert camera.params.tolist() == pytest.approx(
            [0.95 * max(camera.width, camera.height)] * 2 + [camera.width / 2, camera.height / 2]
        )
        np.testing.assert_allclose(
            image.cam_from_world().matrix(), frame.camera.viewmat[:3], atol=1e-12
        )
    for group in (scene.clutter, scene.extra):
        assert len({frame.image.shape for frame in group}) == 3


def test_points_are_observed_by_three_photos_and_never_through_an_occluder(scene):
    model = pycolmap.Reconstruction(scene.folder / "dense" / "sparse")
    assert model.num_points3D() == scene.points.xyz.shape[1] > 150
    assert min(point.track.length() for point in model.points3D.values()) >= 3
    frames = {f"{f.name}.png": f for f in scene.clutter + scene.extra}
    for image in model.images.values():
        frame, ids = frames[image.name], [p.point3D_id - 1 for p in image.points2D]
        pixels, _ = frame.camera.project(scene.points.xyz[:, ids])
        columns, rows = pixels.astype(int)
        assert (frame.coverage[rows, columns] == 0).all()
        assert np.isfinite(frame.depth[rows, columns]).all()
        noise = np.stack([p.xy for p in image.points2D], axis=1) - pixels
        assert np.abs(noise).max() < 6 * scene.spec.pixel_noise


def test_the_package_reads_the_reconstruction(scene):
    capture = read_reconstruction(scene.folder, Path("dense/sparse"))
    assert len(capture.frames) == 9


def test_one_seed_gives_the_same_files_and_another_seed_others(scene, tmp_path):
    write_scene(SMALL, tmp_path / "again")
    write_scene(replace(SMALL, seed=1), tmp_path / "other")
    here, again, other = (
        {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.*")}
        for root in (scene.folder, tmp_path / "again", tmp_path / "other")
    )
    assert here == again
    assert here.keys() == other.keys()
    changed = {name for name in here if here[name] != other[name]}
    assert changed >= {name for name in here if name.endswith((".png", ".json"))}


def test_a_photo_tourism_folder_with_pictures_is_left_alone(scene):
    before = (scene.folder / "light.json").read_bytes()
    with pytest.raises(ConfigError, match="already holds pictures"):
        write_scene(replace(SMALL, seed=1), scene.folder)
    assert (scene.folder / "light.json").read_bytes() == before
