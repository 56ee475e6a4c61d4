"""What a study compares: one thing at a time, the base with every seed first."""

from __future__ import annotations

from itertools import product

import pytest

from desplat_ns.settings.effects import Effects
from desplat_ns.studies.methods import parse
from desplat_ns.studies.plan import BACKEND, BASE, SEEDS, TrainingPlan, compared
from desplat_ns.studies.runs import Variant
from tests.helpers.tradeoff import CAPTURE

EFFECTS = "--pipeline.model.effects."


def options_of(variant: Variant) -> dict[str, str]:
    """By their names."""
    return dict(zip(variant.options[::2], variant.options[1::2], strict=True))


@pytest.mark.parametrize(
    "base", [Effects(), Effects(False, "camera", "image"), Effects(True, "affine", "sh")]
)
def test_each_variant_differs_from_the_base_in_one_thing(base):
    variants = compared(base)
    first, *_, last = variants
    assert (first, last) == (BASE, BACKEND)
    theirs = options_of(variants[BASE])
    assert theirs[f"{EFFECTS}appearance"] == base.appearance
    for name, variant in variants.items():
        ours = options_of(variant)
        changed = {k for k in ours if ours[k] != theirs.get(k)} - {"--pipeline.evaluation.protocol"}
        assert len(changed) == (name != BASE), name


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_the_method_understands_every_variant():
    """And photos of a light of their own are scored in it."""
    plan = TrainingPlan(500, tuple(compared(CAPTURE.effects)), 30_000)
    configs = {run.variant.name: parse("desplat", [*run.options]) for run in plan.runs(CAPTURE)}
    assert set(configs) == set(compared(CAPTURE.effects))
    assert configs["degree-1"].pipeline.model.sh_degree == 1
    assert configs["half-size"].pipeline.model.train_downscale == 2
    for name, protocol in ((BASE, "right"), ("appearance-camera", "half")):
        assert configs[name].pipeline.evaluation.protocol == protocol


def test_every_run_is_there_once_and_the_base_comes_before_what_is_compared_with_it():
    plan = TrainingPlan(500, (BASE, "fewer"), 30_000)
    runs = plan.runs(CAPTURE)
    assert len(runs) == len(set(runs))
    assert [run.steps for run in runs[:4]] == [125, 250, 500, 1000]
    assert {(r.variant.name, r.seed) for r in runs if r.steps == 500} == set(
        product((BASE, "fewer"), SEEDS)
    )
    assert [run.steps for run in runs[-4:-1]] == [4000] * 3
    assert (runs[-1].variant.name, runs[-1].steps) == (BACKEND, 125), "the slow backend comes last"


def test_no_run_is_longer_than_the_method():
    steps = {run.steps for run in TrainingPlan(500, (BASE,), 1500).runs(CAPTURE)}
    assert steps == {125, 250, 500, 1000}
