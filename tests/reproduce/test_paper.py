"""The paper's figures were copied without a slip, as far as they check each other."""

from __future__ import annotations

import pytest

from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.paper import MEAN, figures_of, published, rows_of
from desplat_ns.reproduce.tables import TABLES, TableName

ROUNDING: dict[TableName, float] = {"A7": 0.01, "A8": 1.0, "A9": 0.01}
"""Of a mean and of what it is of, half a unit of the last digit each."""


@pytest.mark.parametrize("table", ROUNDING)
def test_the_last_column_is_the_mean_of_the_others(table: TableName):
    """Of WildGaussians, with its dashes, as well; one is not, in the paper itself."""
    figures = figures_of(table)
    for row, metric in {(row, metric) for row, _, metric in figures}:
        values = [figures[row, scene.name, metric] for scene in TABLES[table].scenes]
        known, mean = [value for value in values if value is not None], figures[row, MEAN, metric]
        if (table, row) == ("A9", "Splatfacto"):
            assert mean == 94.01 and round(sum(known) / len(known), 2) == 94.10
            continue
        assert sum(known) / len(known) == pytest.approx(mean, abs=ROUNDING[table])


def test_figures_are_found_by_row_scene_and_metric():
    assert published("A5", "DeSplat-A", "Sacre Coeur", "psnr") == 22.28
    assert published("A6", "DeSplat", "kitchen", "lpips") == 0.105
    assert published("A6", "DeSplat", MEAN, "psnr") is None
    assert published("A7", "DeSplat", "Yoda", "static_mb") == 38.75
    assert published("A7", "DeSplat", MEAN, "distractor_mb") == 21.01
    assert published("A7", "Splatfacto", "Spot", "distractor_mb") is None
    assert published("A8", "WildGaussians", "Fountain", "train_seconds") == 3600 + 20 * 60 + 30
    assert published("A8", "WildGaussians", "Statue", "train_seconds") is None
    assert published("A9", "DeSplat", "Corner", "fps_with_metrics") == 136.13
    assert published("robustnerf", "DeSplat", "Yoda", "psnr") is None, "it is in the main text"


@pytest.mark.parametrize("table", ["A5", "A6", "A7", "A8", "A9"])
def test_every_row_has_a_figure_for_every_scene_and_methods_stand_beside_rows(table: TableName):
    figures, ours = figures_of(table), TABLES[table]
    for row, metric in {(row, metric) for row, _, metric in figures}:
        assert {scene for r, scene, m in figures if (r, m) == (row, metric)} >= {
            scene.name for scene in ours.scenes
        }
        assert metric in {known.name for known in ours.metrics}
    assert {METHODS[name].paper for name in ours.methods} <= set(rows_of(table))


def test_images_per_second_are_one_over_seconds_per_image():
    scored, alone = TABLES["A9"].metrics
    scores = {"seconds_per_image_render": 0.004, "seconds_per_image_with_metrics": 0.01}
    assert scored.of(scores) == pytest.approx(100) and alone.of(scores) == pytest.approx(250)
    assert scored.of({}) is None and scored.of({"seconds_per_image_with_metrics": 0}) is None


def test_times_are_written_as_the_paper_writes_them():
    (time,) = TABLES["A8"].metrics
    assert time.text(572.4) == "9:32" and time.text(4830) == "80:30"
    assert time.text(-65, "+") == "-1:05" and time.text(5, "+") == "+0:05"
