"""What may be claimed of three seeds and several comparisons, and what may not."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from desplat_ns.studies.plan import BASE, SEEDS
from desplat_ns.studies.runs import Record, Run, Variant
from desplat_ns.studies.summary import (
    NEEDED,
    SIGNIFICANT,
    Measured,
    Spread,
    best_within,
    corrected,
    decibels_to_tell,
    finals,
    least_ratio,
    measured,
    on_front,
    p_value,
    soonest_at,
    times_to_tell,
    verdicts,
)


def point(psnr: tuple[float, ...], wall: float = 10.0, variant: str = "other") -> Measured:
    figures = {"psnr": Spread(psnr), "train_wall_seconds": Spread((wall,) * len(psnr))}
    return Measured(variant, 100, 100, SEEDS[: len(psnr)], figures)


def test_three_seeds_that_do_not_overlap_are_no_claim_among_eight_comparisons():
    """t = 0.3 sqrt(3) / 0.1 = 5.2: p = 0.035 alone, 0.28 as one of eight."""
    base = point((20.0, 20.1, 20.2), variant=BASE)
    apart = point((20.3, 20.5, 20.4))
    assert verdicts([base, apart]) == ["", "+0.30 dB, p = 0.035"]
    assert verdicts([base, *[apart] * 8])[1:] == ["+0.30 dB, not told apart (p = 0.28)"] * 8


def test_what_seeds_have_in_common_hides_no_difference():
    base = point((20.0, 22.0, 24.0), variant=BASE)
    assert verdicts([base, point((20.5, 22.52, 24.48))]) == ["", "+0.50 dB, p < 0.001"]
    assert verdicts([base, point((22.5, 24.48, 20.52))])[1].startswith("+0.50 dB, not told apart")


def test_fewer_seeds_make_no_claim_and_are_no_comparison():
    base = point((20.0, 20.1, 20.2), variant=BASE)
    claims = verdicts([base, point((20.3, 20.5, 20.4)), *[point((25.0,))] * 7])
    assert claims[1] == "+0.30 dB, p = 0.035"
    assert claims[2:] == ["+5.00 dB, 1 of 3 seeds: no claim"] * 7
    assert verdicts([point((20.0,))]) == [""], "there is no base to compare it with"


decibels = st.floats(-5, 5).map(lambda x: round(x, 3))


@given(st.tuples(decibels, decibels, decibels))
def test_p_is_that_of_a_paired_t_test(differences):
    """Both round sums of three numbers; near 0 scipy's own has 1e-12 or so."""
    if len(set(differences)) > 1:
        expected = stats.ttest_1samp(differences, 0.0)[1]
        assert p_value(differences) == pytest.approx(expected, rel=1e-6)


def test_a_plan_has_as_many_seeds_as_a_claim_needs():
    assert len(SEEDS) == NEEDED


def test_differences_without_any_scatter_are_beyond_doubt_or_none():
    assert p_value((0.5, 0.5, 0.5)) == 0.0 and p_value((0.0, 0.0, 0.0)) == 1.0


def test_holms_correction_is_as_worked_out_by_hand():
    """4 x 0.01, 3 x 0.02, then 2 x 0.022 and 0.5, but no less than what comes before."""
    corrections = corrected([0.02, 0.5, 0.01, 0.022])
    assert corrections == pytest.approx([0.06, 0.5, 0.04, 0.06])
    assert corrected([]) == [] and corrected([0.7, 0.8]) == [1.0, 1.0]


@pytest.mark.parametrize("number", [1, 8])
def test_the_least_ratio_is_that_at_which_the_claim_begins(number):
    ratio = least_ratio(number)
    mean, scatter = ratio, 1.0
    differences = (mean - scatter, mean, mean + scatter)
    assert number * p_value(differences) == pytest.approx(SIGNIFICANT)


def test_seeds_come_together_step_by_step():
    runs = [Run(Variant(BASE), 100, seed, Path("/photos")) for seed in SEEDS]
    records = {
        run.name: Record(
            {"psnr": 20.0 + i, "train_wall_seconds": 10.0 + i},
            "c",
            curve=(
                {"step": 50, "psnr": 15.0 + i, "train_wall_seconds": 4.0},
                {"step": 100, "psnr": 20.0 + i, "train_wall_seconds": 10.0 + i},
            ),
        )
        for i, run in enumerate(runs)
    }
    way, end = measured(runs, records)
    assert (way.done, way.psnr.median, way.is_final) == (50, 16.0, False)
    assert (end.done, end.psnr.least, end.psnr.most, end.seeds) == (100, 20.0, 22.0, SEEDS)
    assert finals([way, end]) == [end]
    assert measured(runs, {}) == []


def test_the_front_holds_what_nothing_beats():
    points = [point((20.0,), 10.0), point((21.0,), 12.0), point((20.5,), 13.0), point((19.0,), 5.0)]
    assert on_front(points) == {0, 1, 3}


def test_time_and_quality_are_told_from_what_was_measured():
    points = [point((20.2,), 6.0), point((22.4,), 40.0), point((22.0,), 50.0)]
    best = best_within(45, points)
    assert best is not None and best.psnr.median == 22.4
    assert best_within(5, points) is None
    soonest = soonest_at(21, points)
    assert soonest is not None and soonest.wall.median == 40.0
    assert soonest_at(23, points) is None
    assert times_to_tell(points) == [10, 15, 30, 60]
    assert decibels_to_tell(points) == [21, 22]
