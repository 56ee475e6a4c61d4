from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict

import pytest

from desplat_ns.backend import blending
from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.calibration.scenes import make_scene
from lab.pixels import budgeted_turns, dial_study
from lab.pixels.dial_points import ANTIALIASING, APPEARANCE, RASTERIZING, DialStudy
from lab.pixels.dial_study import measure_dials

SCENE = make_scene(100, 32, 16)


@pytest.fixture(scope="module")
def study() -> DialStudy:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budgeted_turns, "MOST_TURNS", 1)
        patch.setattr(budgeted_turns, "FAST_ROUNDS", 0)
        return measure_dials(SCENE, 120.0, lambda line: None)


def test_every_group_has_one_default(study):
    defaults = Counter(point.group for point in study.points if point.is_default)
    assert defaults == dict.fromkeys((RASTERIZING, ANTIALIASING, APPEARANCE), 1)


def test_every_dial_of_every_backend_is_measured_or_left_out_with_a_reason(study):
    labels = [(x.group, x.backend, x.dial, x.value) for x in (*study.points, *study.left_out)]
    assert len(set(labels)) == len(labels)
    for name in ("numba", "torch"):
        values = {
            (dial, value) for group, b, dial, value in labels if (group, b) == (RASTERIZING, name)
        }
        assert {(p.dial, p.value) for p in dial_study.DIALS} < values
    assert all(case.reason for case in study.left_out)


def test_all_of_it_becomes_json(study):
    assert json.loads(json.dumps(asdict(study)))["scene"] == SCENE.name


def test_errors_do_not_depend_on_the_backend(study):
    """Float32 rounds at 6e-8; 60 Gaussians blend in a pixel, 10 operations each."""
    numba, torch = (
        {(p.group, p.dial, p.value): p.picture_error for p in study.points if p.backend == name}
        for name in ("numba", "torch")
    )
    both = numba.keys() & torch.keys()
    assert len(both) > 10
    assert all(abs(numba[key] - torch[key]) < 60 * 10 * 6e-8 for key in both)


def test_what_would_take_too_long_is_left_out_and_told(monkeypatch):
    """A second passes before anything begins: only the truth, which has no budget, is drawn."""
    lines: list[str] = []
    # Whatever the processor:
    monkeypatch.setattr(dial_study, "bfloat16_unavailable_reason", lambda: None)
    monkeypatch.setattr(dial_study, "Budget", lambda seconds: budgeted_turns.Budget(seconds, 0.0))
    study = measure_dials(SCENE, 1.0, lines.append)
    assert study.points == []
    assert {case.reason for case in study.left_out if case.group == APPEARANCE} <= {
        "no time for its truth"
    }
    assert "no time was left of 1 s" in {case.reason for case in study.left_out}
    assert sum("left out" in line for line in lines) == len(study.left_out)
    assert blending.ALPHA_CUTOFF == ALPHA_CUTOFF


def test_a_backend_that_cannot_run_is_named(monkeypatch):
    runnable = dial_study.backends()[0]
    monkeypatch.setattr(dial_study, "backends", lambda: (runnable, {"other": "needs a machine"}))
    monkeypatch.setattr(dial_study, "Budget", lambda seconds: budgeted_turns.Budget(seconds, 0.0))
    left_out = measure_dials(SCENE, 1.0, lambda line: None).left_out
    assert any((case.backend, case.reason) == ("other", "needs a machine") for case in left_out)
