"""Studies of captures, as the document shows them."""

from __future__ import annotations

import json

import pytest

from desplat_ns.studies.plan import BASE, TrainingPlan
from desplat_ns.studies.results import Results
from lab.front import studies
from tests.helpers.tradeoff import CAPTURE, made_up


@pytest.mark.usefixtures("tyro_may_build")
def test_a_kept_study_says_nothing_of_the_machine_and_is_compared(tmp_path, monkeypatch):
    monkeypatch.setattr(studies, "FOLDER", tmp_path / "kept")
    settled = TrainingPlan(500, (BASE, "fewer"), 30_000)
    training = {run.name: made_up(run) for run in settled.runs(CAPTURE) if run.steps <= 500}
    failed = {"fewer": "see /photos/run.log"}
    Results(CAPTURE, plan=settled, training=training, failed=failed).save(tmp_path / "out")
    (tmp_path / "out" / "training.svg").write_text("<svg/>")
    kept = studies.keep(tmp_path / "out", "garden")
    assert "/photos" not in kept.read_text()
    results = studies.results()
    assert json.loads(kept.read_text()) == results["garden"]
    assert "| `garden` | 20 |" in studies.time_table(results)
    row = studies.settings_table(results).splitlines()[-1]
    assert row.startswith("| a quarter of the static Gaussians at most |") and "3 seeds" in row
