"""A generated capture as Photo Tourism's scenes lie on the disk."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from desplat_ns.data.images import read_image
from lab.synthetic import SceneSpec, write_scene
from lab.synthetic.layouts import pycolmap

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


def test_the_split_file_gives_the_ids_of_the_reconstruction(scene):
    with (scene.folder / "yard.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    model = pycolmap.Reconstruction(scene.folder / "dense" / "sparse")
    assert {row["filename"]: int(row["id"]) for row in rows} == {
        image.name: image_id for image_id, image in model.images.items()
    }
    splits = {row["filename"]: row["split"] for row in rows}
    for split, frames in (("train", scene.clutter), ("test", scene.extra)):
        named = {name for name, kind in splits.items() if kind == split}
        assert named == {f"{frame.name}.png" for frame in frames}


def test_photos_of_every_size_agree_with_their_cameras_in_the_reconstruction(scene):
    model = pycolmap.Reconstruction(scene.folder / "dense" / "sparse")
    assert model.num_cameras() == 3
    frames = {f"{f.name}.png": f for f in scene.clutter + scene.extra}
    for image in model.images.values():
        frame, camera = frames[image.name], model.cameras[image.camera_id]
        photo = read_image(scene.folder / "dense" / "images" / image.name)
        np.testing.assert_array_equal(photo, frame.image)
        assert frame.image.shape == (camera.height, camera.width, 3)
        pose = image.cam_from_world().matrix()
        np.testing.assert_allclose(pose, frame.camera.viewmat[:3], atol=1e-12)
        ids = [point.point3D_id - 1 for point in image.points2D]
        columns, rows = frame.camera.project(scene.points.xyz[:, ids])[0].astype(int)
        assert (frame.coverage[rows, columns] == 0).all(), "nothing is seen through an occluder"
    assert min(point.track.length() for point in model.points3D.values()) >= 3
