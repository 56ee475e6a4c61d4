from __future__ import annotations

import json

from lab.front.budgets import enter
from lab.front.kept import Kept
from lab.front.report import front_table
from lab.front.runs import CHOSEN_ON, PLAN, REPORTED_ON


def test_scenes_to_choose_on_are_not_those_to_report_on():
    assert not set(CHOSEN_ON) & set(REPORTED_ON)
    assert {run.scene for run in PLAN} == {*CHOSEN_ON, *REPORTED_ON}
    assert len(PLAN) == len(set(PLAN))


def test_a_table_without_records_says_so():
    assert front_table({}, CHOSEN_ON) == "*not measured yet*"


def test_a_run_that_is_measured_again_replaces_its_row(tmp_path, monkeypatch):
    file = tmp_path / "budgets.json"
    monkeypatch.setattr("lab.front.budgets.FILE", file)
    first = Kept("fox", "2min", "nothing", 150.0, 1000, 900, 1)
    for kept in (first, Kept("fox", "2min", "nothing", 118.0, 1000, 1100, 2)):
        enter(kept)
    (only,) = [Kept(**run) for run in json.loads(file.read_text("utf8"))]
    assert only.row() == "| fox | nothing | 2min | 118 s (98%) | 1,000 | 1,100 | 1/2 |"
