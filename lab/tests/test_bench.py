"""Errors are of the truth, and the table has every case."""

from __future__ import annotations

import pytest
import torch

from lab.bench.__main__ import STEPS, main
from lab.bench.drawing import (
    DIALS,
    EXACT,
    SUPERSAMPLED,
    TODAY,
    Contender,
    Drawing,
    Setting,
    contenders,
    errors_of,
)
from lab.bench.scenes import make_scene

SCENE = make_scene(200, 48, 32)


def contender(name: str) -> Contender:
    return next(c for c in contenders()[0] if c.name == name and c.device == "cpu")


@pytest.mark.parametrize("name", ["numba", "torch"])
def test_with_limits_that_stand_for_none_only_rounding_is_left(name: str):
    truth = Drawing(contender("torch"), SCENE, EXACT).drawn()
    loose = Setting(cutoff=EXACT.cutoff, stop=EXACT.stop)
    errors = errors_of(Drawing(contender(name), SCENE, loose).drawn(), truth)
    today = errors_of(Drawing(contender(name), SCENE, TODAY).drawn(), truth)
    assert errors.picture < 1e-5 < today.picture
    assert errors.gradient < 1e-3 < today.gradient


def test_pictures_of_other_sizes_are_compared_in_the_scenes_size():
    numba = contender("numba")
    truth = Drawing(numba, SCENE, SUPERSAMPLED).drawn()
    half = Drawing(numba, SCENE, DIALS["resolution 1/2"]).drawn()
    assert truth.picture.shape == half.picture.shape == (32, 48, 3)
    assert truth.picture.dtype == torch.float64
    assert errors_of(truth, truth).picture == 0


@pytest.mark.slow
def test_a_quick_run_has_a_row_for_each_case(capsys: pytest.CaptureFixture[str]):
    main(["--quick"])
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| 0.3k")]
    cases = [row.split("|")[2].strip() for row in rows]
    assert set(STEPS) | set(DIALS) <= set(cases)
    assert len({row.count("|") for row in rows}) == 1
