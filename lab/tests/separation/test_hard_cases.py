"""Difficult occluders, and the model of one pixel."""

from __future__ import annotations

import numpy as np
import pytest

from desplat_ns.data.images import read_image, read_mask
from lab.separation import one_pixel
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


def test_one_pixel_shows_haze_with_one_loss_and_none_with_placed_distractors():
    paper, *_, placed = (one_pixel.simulate(rules, 1500) for rules in one_pixel.RULES)
    assert paper.haze[-1] > 0.04
    assert placed.haze[-1] == 0
    assert placed.cover[-1] > 0.5 > paper.cover[-1]
    assert placed.error[-1] < 0.02
