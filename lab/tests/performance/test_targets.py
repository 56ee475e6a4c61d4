from __future__ import annotations

import pytest

from desplat_ns.calibration.timing import Timing
from lab.performance.pairs import Pairs
from lab.performance.results import Results
from lab.performance.steps import StepTimes
from lab.performance.targets import targets
from lab.performance.training_step import ADAM, LOSS, OTHER, PARTS, PULL
from lab.pixels.accuracy import Errors
from lab.pixels.rasterizing import BLENDING, WHOLE, Row


def once(milliseconds: float) -> Timing:
    return Timing(cpu=[milliseconds], wall=[milliseconds])


@pytest.fixture
def results() -> Results:
    """Yardstick 1000 ms, numba 20 ms blending (5 forward) and 40 in all; steps of 1000 and 50."""
    measured = Results({}, {}, scenes=["s"], peaks={256: 100.0, 512: 200.0})
    for part, ms in ((BLENDING, 20.0), (WHOLE, 40.0)):
        measured.rows.append(Row("s", "yardstick", part, 1, once(500.0), once(1000.0)))
        measured.rows.append(Row("s", "numba", part, 1, once(5.0), once(ms)))
    parts = {**dict.fromkeys(PARTS, 0.0), PULL: 26.0, LOSS: 16.0, ADAM: 5.0, OTHER: 3.0}
    measured.steps.append(StepTimes("s", "yardstick", 1, once(1000.0), parts))
    measured.steps.append(StepTimes("s", "numba", 1, once(50.0), parts))
    measured.pairs["s"] = Pairs(9, 8, 5_000_000, 4_000_000)
    measured.errors.append(Errors("s", "numba", 0.1, 1e-5, 2e-5, {}))
    return measured


def test_targets_are_judged_by_hand_worked_ratios(results):
    rows = {t.text.removeprefix("s: "): (t.measured, t.met) for t in targets(results)}
    assert rows["forward + backward, blending alone, at least 35 x"] == ("50.0 x", True)
    assert rows["forward + backward, blending alone, at least 60 x (stretch)"] == ("50.0 x", False)
    assert rows["forward + backward, whole call, at least 35 x"] == ("25.0 x", False)
    # 4e6 pairs x 30 in 5 ms are 24 GFLOP/s, of 200
    share = "forward, contributing pairs, at least 10% of the peak (stretch)"
    assert rows[share] == ("12.0%", True)
    assert rows["whole training step at least 15 x"] == ("20.0 x", True)
    assert rows["no part but the rasterizer over 30% of the step"] == (f"32% ({LOSS})", False)
    assert rows["the parts add up to the uninterrupted step within 10%"][1]
    assert rows["at most 0.0005 of the pixels flip at a threshold"] == ("2.0e-05", True)


def test_the_backward_pass_is_the_difference(results):
    assert results.gflops("s", 1_000_000, True, 54) == pytest.approx(1e6 * 54 / 15e-3 / 1e9)


def test_what_was_not_measured_is_an_error(results):
    with pytest.raises(KeyError):
        results.row("s", "numba", WHOLE, threads=7)
    with pytest.raises(KeyError):
        results.step("s", "torch")
