"""Means over seeds and differences, worked out by hand."""

from __future__ import annotations

import pytest

from desplat_ns.reproduce.cells import Cell, cells_of
from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.paper import MEAN
from desplat_ns.reproduce.tables import TABLES

A5, A9 = TABLES["A5"], TABLES["A9"]
SCENES = [scene.name for scene in A5.scenes]
DESPLAT = METHODS["desplat-phototourism-paper"]


def psnr(scene: str, seed: int) -> float:
    return {"Brandenburg Gate": 25.0, "Sacre Coeur": 20.0, "Trevi Fountain": 24.0}[scene] + seed


def by_scene(scenes, is_smoke=False, absent=()) -> dict[str, Cell]:
    def lookup(scene, method, seed):
        return None if (scene, seed) in absent else {"psnr": psnr(scene, seed)}

    cells = cells_of(A5, scenes, [DESPLAT], (0, 1), lookup, is_smoke)
    assert {cell.metric.name for cell in cells} == {"psnr"}, "what was not measured is left out"
    return {cell.scene: cell for cell in cells}


def test_a_figure_is_the_mean_of_seeds_beside_the_papers():
    cell = by_scene(SCENES)["Sacre Coeur"]
    assert cell.values == (20.0, 21.0) and cell.mean == 20.5
    assert cell.paper == 20.14 and cell.difference == pytest.approx(0.36)


def test_the_mean_is_that_of_scenes_and_then_of_seeds():
    cell = by_scene(SCENES)[MEAN]
    assert cell.values == (23.0, 24.0) and cell.mean == 23.5
    assert cell.paper is None and cell.difference is None, "the paper has none in A5"


def test_there_is_no_mean_of_a_part_of_the_scenes():
    assert MEAN not in by_scene(SCENES[:2])


def test_a_seed_without_a_scene_is_in_no_mean():
    cells = by_scene(SCENES, absent=[("Sacre Coeur", 1)])
    assert cells["Sacre Coeur"].values == (20.0,) and cells[MEAN].values == (23.0,)


def test_nothing_of_a_smoke_run_stands_beside_the_papers():
    assert all(cell.paper is None for cell in by_scene(SCENES, is_smoke=True).values())


def test_images_per_second_are_one_over_seconds_per_image():
    figures = {"seconds_per_image_render": 0.004, "seconds_per_image_with_metrics": 0.01}
    scored, alone = A9.metrics
    assert scored.of(figures) == pytest.approx(100) and alone.of(figures) == pytest.approx(250)
    assert scored.of({}) is None and scored.of({"seconds_per_image_with_metrics": 0}) is None


def test_times_are_written_as_the_paper_writes_them():
    (time,) = TABLES["A8"].metrics
    assert time.text(572.4) == "9:32" and time.text(4830) == "80:30"
    assert time.difference(-65) == "-1:05" and time.difference(5) == "+0:05"
