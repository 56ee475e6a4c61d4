from __future__ import annotations

import pytest

from desplat_ns.calibration.timing import Timing
from lab.gpu.parts import steps
from lab.gpu.plan import Job
from lab.gpu.scenes import NONE_PLACED, PLACED, PLAIN, SPLATFACTO


def test_ratios_are_of_medians_to_splatfactos():
    timings = {SPLATFACTO: Timing(wall=[9.0, 10.0, 50.0]), PLACED: Timing(wall=[11.0, 12.0, 90.0])}
    assert steps._row("a scene", PLACED, timings)["ratio"] == 1.2
    assert steps._row("a scene", SPLATFACTO, timings)["ratio"] == 1.0


@pytest.mark.slow
def test_all_cases_are_timed_in_one_run(tmp_path):
    (figures,) = steps.measure(Job("cpu", True, str(tmp_path)))
    assert [row["case"] for row in figures["rows"]] == [SPLATFACTO, PLAIN, NONE_PLACED, PLACED]
    for row in figures["rows"]:
        assert 0 < row["ms"]["low"] <= row["ms"]["median"] <= row["ms"]["high"]
