"""Scenes of captures, trained shortly: the page shows what we render, and is as like the photos.

The page of `fox_cluttered` is tested in the package's suite, with the files of the same run
(tests/export).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run
from lab.synthetic import SceneSpec, write_scene
from tests.helpers.browser import find_browser
from tests.helpers.page_beside_photos import LEAST_PSNR, MOST_BELOW, page_beside_photos, short_run

pytestmark = pytest.mark.slow

STEPS = 80


def test_the_page_of_the_demos_scene_shows_what_we_render(tmp_path: Path):
    find_browser()
    write_scene(SceneSpec(), tmp_path / "yard")
    run = short_run(tmp_path / "yard", 2, STEPS, tmp_path / "runs")
    comparison = page_beside_photos(load_run(find_run(run)), tmp_path)
    assert comparison.of_ours.min() > LEAST_PSNR, comparison
    assert comparison.below_ours.max() < MOST_BELOW, comparison


@pytest.mark.real_data
def test_the_page_of_a_capture_all_around_shows_what_we_render(
    data_folder: Callable[[str], Path], tmp_path: Path
):
    data = data_folder("monstree_cluttered")
    find_browser()
    run = short_run(data, 4, STEPS, tmp_path / "runs")
    comparison = page_beside_photos(load_run(find_run(run)), tmp_path)
    assert comparison.of_ours.min() > LEAST_PSNR, comparison
    assert comparison.below_ours.max() < MOST_BELOW, comparison
