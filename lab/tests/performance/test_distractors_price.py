"""Each case is the phase and the distractors that it is called after."""

from __future__ import annotations

import pytest

from desplat_ns.calibration.timing import Timing
from desplat_ns.separation import layer
from lab.front.whole_step import SETTLED, Size, WholeStep
from lab.performance.distractors_price import (
    AFTER,
    CASES,
    OFF,
    SIZES,
    WARM_UP,
    Price,
    cases_of,
    in_phase,
    put_in_the_way,
)


def test_a_phase_draws_and_leaves_out_what_a_run_does_in_it(monkeypatch):
    step, drawn, ignored = WholeStep(Size(5, 50, 32, 24, 3)), [], []
    loss = layer.distractor_weight
    monkeypatch.setattr(
        layer, "distractor_weight", lambda alpha, out: (ignored.append(out), loss(alpha, out))[1]
    )
    commit = layer.DistractorLayer.commit

    def watched(self, train_step, *args):
        drawn.append(train_step.distractors is not None)
        assert train_step.residual_stats is not None, "the search is in every phase"
        commit(self, train_step, *args)

    monkeypatch.setattr(layer.DistractorLayer, "commit", watched)
    for phase in (WARM_UP, AFTER):
        in_phase(step, phase)
    assert drawn == [False, True]
    assert len(ignored) == 1 and ignored[0] is not None
    assert step.model.distractors is not None and step.model.distractors.total == 5 * 3


def test_every_case_takes_steps_of_the_same_static_scene():
    cases = cases_of(60, 32, 24)
    assert list(cases) == [OFF, *CASES]
    for step in cases.values():
        step()
    assert {phase for _, phase in CASES.values()} == {WARM_UP, AFTER}


def test_what_is_in_the_way_covers_its_share_of_the_photo():
    step = WholeStep(Size(2, 60, 80, 60, 0))
    step.model.config.background_color = "black"  # the same in both renderings
    put_in_the_way(step, 0.25)
    step.model.step = SETTLED
    outputs = step.model(step.camera)
    differs = (step.photo - outputs["rgb_static"]).abs().amax(-1) > 1e-6
    assert 0.2 < differs.float().mean() < 0.3
    alpha = outputs["alpha_distractor"][..., 0]
    assert alpha[differs].mean() > 3 * alpha[~differs].mean()


def test_a_price_is_of_one_run_in_cpu_and_in_wall_time():
    steps = {OFF: Timing([20.0], [10.0]), "warm-up": Timing([22.0], [15.0])}
    assert Price("s", 2, steps).ratios("warm-up") == (pytest.approx(1.1), pytest.approx(1.5))


def test_nine_scenes_are_measured():
    assert len(set(SIZES)) == 9
