"""Altered captures: difficult occluders, few views; and the model of one pixel."""

import numpy as np
import pycolmap
import pytest

from desplat_ns.data.images import read_image, read_mask
from lab.separation import one_pixel
from lab.separation.few_views import keep_views
from lab.separation.hard_cases import CASES, RECURRING, make_case
from lab.synthetic import Scene

SHARES = {"white": (0.05, 0.13), "black": (0.05, 0.13), "large": (0.3, 0.5), "small": (0.05, 0.16)}


@pytest.fixture(scope="module")
def cases(tiny_scene: Scene, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("cases")
    assert tiny_scene.folder is not None
    for name in (*CASES, RECURRING):
        make_case(name, tiny_scene.folder, folder / name)
    return folder


@pytest.mark.parametrize("name", CASES)
def test_a_case_covers_what_it_says_and_differs_nowhere_else(cases, tiny_scene, name):
    masks = []
    for path in sorted((cases / name / "images").glob("clutter_*")):
        mask = read_mask(cases / name / "masks" / f"{path.stem}.png")
        clean = path.name.replace("clutter", "clean")
        photo, original = read_image(path), read_image(tiny_scene.folder / "images" / clean)
        assert np.array_equal(photo[~mask], original[~mask])
        masks.append(mask.mean())
    low, high = SHARES[name]
    assert low < np.mean(masks) < high


def test_the_recurring_one_stands_in_a_fifth_of_the_views(cases):
    masks = sorted((cases / RECURRING / "masks").iterdir())
    covered = [read_mask(path).mean() for path in masks]
    assert [share > 0.02 for share in covered] == [True, True, False, False, False, False]


def test_of_few_views_the_photos_are_spread_evenly_and_the_reconstruction_has_no_others(
    tiny_scene: Scene, tmp_path
):
    assert tiny_scene.folder is not None
    keep_views(3, tiny_scene.folder, tmp_path)
    names = {path.name for path in (tmp_path / "images").iterdir()}
    kept = [f"{kind}_{i:04d}.png" for kind in ("clean", "clutter") for i in (1, 3, 6)]
    assert names == {*kept, "extra_0001.png", "extra_0002.png"}
    assert read_image(tmp_path / "images" / "clutter_0003.png").shape == (32, 48, 3)
    assert (tmp_path / "masks" / "clutter_0003.png").is_file()
    whole, few = (
        pycolmap.Reconstruction(f / "sparse" / "0") for f in (tiny_scene.folder, tmp_path)
    )
    assert {image.name for image in few.images.values()} == names
    assert 0 < len(few.points3D) <= len(whole.points3D)
    poses = {i.name: i.cam_from_world().matrix() for i in whole.images.values()}
    for image in few.images.values():
        assert image.cam_from_world().matrix() == pytest.approx(poses[image.name])


def test_one_pixel_shows_haze_with_one_loss_and_none_with_placed_distractors():
    paper, *_, placed = (one_pixel.simulate(rules, 1500)[-1] for rules in one_pixel.RULES)
    (_, haze, cover), (error, no_haze, full_cover) = paper, placed
    assert haze > 0.04 and no_haze == 0
    assert full_cover > 0.5 > cover
    assert error < 0.02
