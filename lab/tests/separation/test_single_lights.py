from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.data.images import read_image
from lab.separation.single_lights import EXPOSURES, FLARES, STRENGTH, light_some
from lab.synthetic import SceneSpec, write_scene


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    scene = tmp_path_factory.mktemp("scene")
    write_scene(SceneSpec.tiny(), scene)
    lit = tmp_path_factory.mktemp("lit")
    light_some(scene, lit)
    return scene, lit


def change(folders, name: str) -> np.ndarray:
    """Lit photo minus original, in [-1, 1]."""
    scene, lit = (read_image(folder / "images" / name) / 255.0 for folder in folders)
    return lit - scene


def names(folders, kind: str) -> list[str]:
    return sorted(path.name for path in (folders[1] / "images").glob(f"{kind}_*"))


def test_every_third_photo_has_a_flare_and_the_others_another_exposure(folders):
    scene = folders[0]
    for index, name in enumerate(names(folders, "clean")):
        found, turn = change(folders, name), index % FLARES
        if turn == 0:
            assert found.min() >= -1 / 255
            assert found.max() < STRENGTH[1] + 1 / 255
            assert found.max() > 3 * np.median(found)
        else:
            photo = read_image(scene / "images" / name) / 255.0
            expected = (photo * EXPOSURES[turn - 1]).clip(0, 1) - photo
            np.testing.assert_allclose(found, expected, atol=0.51 / 255)


def test_a_view_and_its_twin_have_the_same_light(folders):
    scene = folders[0]
    for clutter, clean in zip(names(folders, "clutter"), names(folders, "clean"), strict=True):
        originals = [read_image(scene / "images" / name) for name in (clutter, clean)]
        same = (originals[0] == originals[1]).all(-1)
        assert same.any()
        np.testing.assert_array_equal(change(folders, clutter)[same], change(folders, clean)[same])


def test_masks_and_held_out_photos_stay(folders):
    scene, lit = folders
    assert (lit / "masks").resolve() == (scene / "masks").resolve()
    for name in names(folders, "extra"):
        assert not change(folders, name).any()
