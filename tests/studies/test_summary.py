"""What pays, and what may be claimed of three seeds and several comparisons."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from desplat_ns.studies.plan import BASE, SEEDS
from desplat_ns.studies.runs import Run
from desplat_ns.studies.summary import (
    Measured,
    bought,
    corrected,
    measured,
    p_value,
    verdicts,
)
from tests.helpers.made_up_runs import made_up


def point(psnr: tuple[float, ...], wall: float = 10.0, variant: str = "other") -> Measured:
    scores = ({"psnr": value, "train_wall_seconds": wall} for value in psnr)
    return Measured(variant, 100, dict(zip(SEEDS, scores, strict=False)))


def test_three_seeds_that_do_not_overlap_are_no_claim_among_eight_comparisons():
    """t = 0.3 sqrt(3) / 0.1 = 5.2: p = 0.035 alone, 0.28 as one of eight."""
    base = point((20.0, 20.1, 20.2), variant=BASE)
    apart = point((20.3, 20.5, 20.4))
    assert verdicts([base, apart]) == ["", "+0.30 dB, p = 0.035"]
    assert verdicts([base, *[apart] * 8])[1:] == ["+0.30 dB, not told apart (p = 0.28)"] * 8


def test_what_seeds_have_in_common_hides_no_difference():
    base = point((20.0, 22.0, 24.0), variant=BASE)
    assert verdicts([base, point((20.5, 22.52, 24.48))]) == ["", "+0.50 dB, p < 0.001"]
    assert "not told apart" in verdicts([base, point((22.5, 24.48, 20.52))])[1]


def test_fewer_seeds_make_no_claim_and_are_no_comparison():
    base = point((20.0, 20.1, 20.2), variant=BASE)
    claims = verdicts([base, point((20.3, 20.5, 20.4)), point((25.0,))])
    assert claims[1:] == ["+0.30 dB, p = 0.035", "+5.00 dB, 1 of 3 seeds: no claim"]
    assert verdicts([point((20.0,))]) == [""], "there is no base to compare it with"


decibels = st.floats(-5, 5).map(lambda x: round(x, 3))


@given(st.tuples(decibels, decibels, decibels))
def test_p_is_that_of_a_paired_t_test(differences):
    """Both round sums of three numbers; near 0 scipy's own has 1e-12 or so."""
    if len(set(differences)) > 1:
        expected = stats.ttest_1samp(differences, 0.0)[1]
        assert p_value(differences) == pytest.approx(expected, rel=1e-6)


def test_differences_without_any_scatter_are_beyond_doubt_or_none():
    assert p_value((0.5, 0.5, 0.5)) == 0.0 and p_value((0.0, 0.0, 0.0)) == 1.0


def test_holms_correction_is_as_worked_out_by_hand():
    """4 x 0.01, 3 x 0.02, then 2 x 0.022 and 0.5, but no less than what comes before."""
    assert corrected([0.02, 0.5, 0.01, 0.022]) == pytest.approx([0.06, 0.5, 0.04, 0.06])
    assert corrected([]) == [] and corrected([0.7, 0.8]) == [1.0, 1.0]


def test_seeds_come_together():
    runs = [Run(BASE, "desplat", (), 100, seed, Path("/photos")) for seed in SEEDS]
    records = {run.key: made_up(run, Path()) for run in runs[:2]}
    (seen,) = measured(runs, records)
    assert (seen.variant, seen.steps, seen.wall) == (BASE, 100, 10.0)
    assert seen.values("psnr") == [record.scores["psnr"] for record in records.values()]
    assert measured(runs, {}) == []


def test_time_and_quality_are_told_from_what_was_measured():
    points = [point((20.2,), 6.0), point((22.4,), 40.0), point((22.0,), 50.0)]
    assert [(seconds, best.psnr) for seconds, best in bought(points)] == [(10, 20.2), (60, 22.4)]
