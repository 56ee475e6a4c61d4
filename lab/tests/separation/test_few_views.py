from __future__ import annotations

import pycolmap
import pytest

from desplat_ns.data.images import read_image
from lab.separation.few_views import keep_views
from lab.synthetic import SceneSpec, write_scene


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    scene = tmp_path_factory.mktemp("scene")
    write_scene(SceneSpec.tiny(), scene)
    few = tmp_path_factory.mktemp("few")
    keep_views(3, scene, few)
    return scene, few


def test_the_kept_views_are_spread_evenly_and_extras_stay(folders):
    _, few = folders
    names = sorted(path.stem for path in (few / "images").iterdir())
    assert names == [
        *(f"clean_{i:04d}" for i in (1, 3, 6)),
        *(f"clutter_{i:04d}" for i in (1, 3, 6)),
        *(f"extra_{i:04d}" for i in (1, 2)),
    ]
    assert read_image(few / "images" / "clutter_0003.png").shape == (32, 48, 3)
    assert (few / "masks" / "clutter_0003.png").is_file()


def test_the_reconstruction_has_the_kept_photos_alone(folders):
    scene, few = folders
    whole = pycolmap.Reconstruction(scene / "sparse" / "0")
    kept = pycolmap.Reconstruction(few / "sparse" / "0")
    assert {image.name for image in kept.images.values()} == {
        path.name for path in (few / "images").iterdir()
    }
    assert 0 < len(kept.points3D) <= len(whole.points3D)
    poses = {i.name: i.cam_from_world().matrix() for i in whole.images.values()}
    for image in kept.images.values():
        assert image.cam_from_world().matrix() == pytest.approx(poses[image.name])
