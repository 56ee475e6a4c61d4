"""The paper's figures were copied without a slip, as far as they check each other."""

from __future__ import annotations

import pytest

from desplat_ns.reproduce.methods import METHODS
from desplat_ns.reproduce.paper import MEAN, PUBLISHED, published, rows_of
from desplat_ns.reproduce.tables import TABLES

ROUNDING = {"A7": 0.01, "A8": 1.0, "A9": 0.01}
"""Of a mean and of what it is of, half a unit of the last digit each."""


@pytest.mark.parametrize("table", PUBLISHED)
def test_every_row_has_a_figure_for_every_column(table):
    for part in PUBLISHED[table]:
        columns = len(part.scenes) * len(part.metrics)
        assert all(len(row) == columns for row in part.rows.values())


@pytest.mark.parametrize("table", ROUNDING)
def test_the_last_column_is_the_mean_of_the_others(table):
    """Of WildGaussians, with its dashes, as well; one is not, in the paper itself."""
    for part in PUBLISHED[table]:
        for name, (*figures, mean) in part.rows.items():
            known = [figure for figure in figures if figure is not None]
            if (table, name) == ("A9", "Splatfacto"):
                assert mean == 94.01 and round(sum(known) / len(known), 2) == 94.10
                continue
            assert sum(known) / len(known) == pytest.approx(mean, abs=ROUNDING[table])


def test_figures_are_found_by_row_scene_and_metric():
    assert published("A5", "DeSplat-A", "Sacre Coeur", "psnr") == 22.28
    assert published("A6", "DeSplat", "kitchen", "lpips") == 0.105
    assert published("A7", "DeSplat", "Yoda", "static_mb") == 38.75
    assert published("A7", "DeSplat", MEAN, "distractor_mb") == 21.01
    assert published("A7", "Splatfacto", "Spot", "distractor_mb") is None
    assert published("A8", "WildGaussians", "Fountain", "train_seconds") == 3600 + 20 * 60 + 30
    assert published("A8", "WildGaussians", "Statue", "train_seconds") is None
    assert published("A9", "DeSplat", "Corner", "fps_with_metrics") == 136.13
    assert published("robustnerf", "DeSplat", "Yoda", "psnr") is None, "it is in the main text"


@pytest.mark.parametrize("table", PUBLISHED)
def test_the_columns_and_rows_are_those_of_our_tables(table):
    ours = TABLES[table]
    scenes = [scene.name for scene in ours.scenes]
    for part in PUBLISHED[table]:
        assert [scene for scene in part.scenes if scene != MEAN] == scenes
        assert set(part.metrics) <= {metric.name for metric in ours.metrics}
    rows = {METHODS[name].paper for name in ours.methods}
    assert rows <= set(rows_of(table)), "a method stands beside a row that is not there"
