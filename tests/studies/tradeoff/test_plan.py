"""What a study compares: one thing at a time, the base with every seed first."""

from __future__ import annotations

from itertools import product

import pytest

from desplat_ns.effects import Effects
from desplat_ns.studies.grid.settings import differences
from desplat_ns.studies.tradeoff.plan import BACKEND, BASE, SEEDS, TrainingPlan, compared, study_of
from tests.helpers.tradeoff import SUBJECT

SWITCH = "pipeline.model.effects."
SCORED = "pipeline.evaluation.protocol"


@pytest.mark.parametrize(
    "base", [Effects(), Effects(False, "camera", "image"), Effects(True, "affine", "sh")]
)
def test_each_setting_differs_from_the_base_in_one_thing(base):
    settings = compared(base)
    assert settings[BASE].effects == base and not settings[BASE].options
    for name, one in settings.items():
        changed = {k for k in vars(base) if getattr(base, k) != getattr(one.effects, k)}
        assert len(changed) + bool(one.options) == (name != BASE), name


@pytest.mark.usefixtures("tyro_may_build")
def test_the_method_understands_every_setting():
    study = study_of(SUBJECT, TrainingPlan(500, tuple(compared(SUBJECT.effects)), 30_000))
    runs = {run.setting: run for run in study.plan if run.steps == 500 or run.setting == BACKEND}
    base = study.settings_of(runs[BASE])
    assert base[SWITCH + "distractors"] is True and base[SCORED] == "right"
    for name, run in runs.items():
        changed = differences(study.settings_of(run), base)
        apart = [one for one in changed if one.startswith(SWITCH)]
        assert name == BASE or changed
        assert len(apart) <= 1
    lit = study.settings_of(runs["appearance-camera"])
    assert lit[SCORED] == "half", "photos of a light of their own are scored in it"


def test_every_run_is_there_once_and_the_base_comes_before_what_is_compared_with_it():
    plan = TrainingPlan(500, (BASE, "fewer"), 30_000)
    runs = plan.runs()
    assert len(runs) == len(set(runs))
    assert [run.steps for run in runs[:4]] == [125, 250, 500, 1000]
    assert {(r.setting, r.seed) for r in runs if r.steps == 500} == set(
        product((BASE, "fewer"), SEEDS)
    )
    assert [run.steps for run in runs[-4:-1]] == [4000] * 3
    assert (runs[-1].setting, runs[-1].steps) == (BACKEND, 125), "the slow backend comes last"


def test_no_run_is_longer_than_the_method():
    steps = {run.steps for run in TrainingPlan(500, (BASE,), 1500).runs()}
    assert steps == {125, 250, 500, 1000}
