"""What a study compares, and what of it fits into the time."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.settings.effects import Effects
from desplat_ns.studies.methods import Content, parse
from desplat_ns.studies.plan import (
    BASE,
    GROWTH,
    SEEDS,
    SHORTEST,
    WANTED,
    Capture,
    Pace,
    Variant,
    compared,
    first_run,
    fitting,
    planned,
    steps_that_fit,
)
from desplat_ns.studies.runs import Run
from tests.helpers.made_up_runs import made_up

CAPTURE = Capture(Path("/photos/garden"), ("colmap",), Content(20, 3, 120, 80, 500), Effects())
FIRST = first_run(CAPTURE)
EFFECTS = "--pipeline.model.effects."


def records_of(*runs: Run):
    """They take 5 s and a tenth of a second for each step."""
    return {run.key: made_up(run, Path()) for run in runs}


def options_of(variant: Variant) -> dict[str, str]:
    return dict(zip(variant.options[::2], variant.options[1::2], strict=True))


@pytest.mark.parametrize(
    "base", [Effects(), Effects(False, "camera", "image"), Effects(True, "affine", "sh")]
)
def test_each_variant_differs_from_the_base_in_one_thing(base: Effects):
    variants = compared(base)
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
    runs = planned(CAPTURE, 500, 30_000)
    configs = {run.variant: parse("desplat", run.given) for run in runs if run.seed == SEEDS[0]}
    assert set(configs) == set(compared(CAPTURE.effects))
    assert configs["degree-1"].pipeline.model.sh_degree == 1
    for name, protocol in ((BASE, "right"), ("appearance-camera", "half")):
        assert configs[name].pipeline.evaluation.protocol == protocol


def test_every_run_is_there_once_and_the_base_comes_before_what_is_compared_with_it():
    runs = planned(CAPTURE, 500, 30_000)
    assert len(runs) == len({run.key for run in runs}) and runs[0] == FIRST
    assert [run.steps for run in runs[:4]] == [125, 250, 500, 1000]
    whole = {(run.variant, run.seed) for run in runs if run.steps == 500}
    assert whole == set(product(compared(CAPTURE.effects), SEEDS))
    assert max(run.steps for run in planned(CAPTURE, 500, 1500)) == 1000, "no longer than that"


def test_runs_are_expected_to_take_what_the_longest_of_their_variant_took():
    short, long = replace(FIRST, steps=250), replace(FIRST, steps=1000)
    other = replace(long, variant="fewer", options=("--fewer", "1"))
    runs = [FIRST, short, long, other]
    pace = Pace(runs, records_of(FIRST))
    assert pace.seconds(FIRST) == pytest.approx(5 + 12.5)
    assert pace.seconds(long) == pace.seconds(other) == pytest.approx(5 + 100 * GROWTH)
    slow = replace(made_up(other, Path()), seconds=405.0, scores={"train_wall_seconds": 400.0})
    pace = Pace(runs, records_of(FIRST, short) | {other.key: slow})
    assert pace.seconds(long) == pytest.approx(105) and pace.seconds(other) == pytest.approx(405)


@given(seconds=st.floats(30, 1e6))
def test_a_comparison_is_the_longest_that_fits(seconds: float):
    pace = Pace([FIRST], records_of(FIRST))
    steps = steps_that_fit(seconds, pace, CAPTURE, 30_000)

    def cost(steps: int) -> float:
        seeds = SEEDS if steps > WANTED else SEEDS[:1]
        runs = planned(CAPTURE, steps, 30_000)
        return sum(pace.seconds(run) for run in runs if run.seed in seeds)

    assert steps == SHORTEST or cost(steps) <= seconds
    assert 2 * steps > 30_000 or cost(2 * steps) > seconds


def test_runs_that_do_not_fit_are_passed_over_and_asked_for_late():
    runs = [FIRST, *(replace(FIRST, steps=steps) for steps in (10_000, 250))]
    done, left = records_of(FIRST), [100.0]
    coming = fitting(runs, done, lambda: left[0])
    assert next(coming) == runs[2]
    assert next(coming, None) is None
    again = fitting(runs, done, lambda: left[0])
    left[0] = 10.0
    assert next(again, None) is None, "the time is looked at when a run is asked for"
