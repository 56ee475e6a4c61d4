"""What an effect costs is the difference to a step that has none, at the capture's own size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from desplat_ns.calibration import effects_cost
from desplat_ns.calibration.effects_cost import (
    MOST_GAUSSIANS,
    MOST_PIXELS,
    StepSize,
    measure,
)
from desplat_ns.calibration.timing import Timing
from desplat_ns.settings.effects import Effects

NOTHING = Effects(distractors=False)


def test_small_captures_are_measured_as_they_are_and_large_ones_in_their_shape():
    assert StepSize.for_photos(240, 135, 10, 0.05) == StepSize(240, 135, 16_200)
    large = StepSize.for_photos(4000, 3000, 1700, 0.05)
    assert large.num_gaussians == MOST_GAUSSIANS
    assert large.width * large.height == pytest.approx(MOST_PIXELS, rel=0.01)
    assert large.width / large.height == pytest.approx(4 / 3, rel=0.01)


def test_a_disturbed_round_does_not_move_the_ratio_and_wide_spreads_are_told(monkeypatch):
    """What else runs slows all cases of a round; wall times alone see it."""
    base, other = [10.0, 10.0, 30.0, 10.0, 20.0], [15.0, 15.0, 45.0, 15.0, 90.0]
    camera = replace(NOTHING, appearance="camera")
    timings = {str(NOTHING): Timing(base, [1.0] * 5), str(camera): Timing(other, [9.0] * 5)}
    monkeypatch.setattr(effects_cost, "time_in_turns", lambda *_: timings)
    monkeypatch.setattr(effects_cost, "ModelStep", lambda *_: Weightless())
    costs = measure(StepSize(16, 16, 1000), [camera], num_photos=3, rounds=5)
    assert costs[1].ratio == pytest.approx(1.5)
    assert not costs[1].is_wide and "not steady" not in costs[1].words()
    shaken = replace(costs[1], ratio_range=(1.2, 2.0))
    assert "not steady: 1.20 to 2.00" in shaken.words()


class Weightless:
    """Stands for a step that is not run."""

    model = SimpleNamespace(trained_bytes=lambda: 0)


@pytest.mark.slow
def test_every_case_is_told_once_after_the_step_that_has_nothing_on():
    camera = replace(NOTHING, appearance="camera")
    affine = replace(NOTHING, appearance="affine")
    costs = measure(StepSize(64, 48, 1000), [camera, affine, camera], num_photos=3, rounds=1)
    assert [cost.effects for cost in costs] == [NOTHING, camera, affine]
    assert costs[0].ratio == 1 and costs[0].extra_bytes == 0
    assert costs[1].extra_bytes == 3 * 4 * 3 * 5  # three photos, five numbers, and their moments
    assert costs[2].extra_bytes > 3 * 4 * 24 * 1000
    assert "appearance camera" in costs[1].words() and "nothing on" in costs[0].words()
