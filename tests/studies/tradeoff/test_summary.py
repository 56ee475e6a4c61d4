"""What may be claimed: only what every seed says."""

from __future__ import annotations

from desplat_ns.studies.grid.records import Record
from desplat_ns.studies.grid.runs import Run
from desplat_ns.studies.tradeoff.plan import BASE, SEEDS
from desplat_ns.studies.tradeoff.summary import (
    Measured,
    Spread,
    best_within,
    decibels_to_tell,
    finals,
    measured,
    on_front,
    soonest_at,
    times_to_tell,
    verdict,
)


def one(psnr: tuple[float, ...], wall: float = 10.0, setting: str = "other") -> Measured:
    figures = {"psnr": Spread(psnr), "train_wall_seconds": Spread((wall,) * len(psnr))}
    return Measured(setting, 100, 100, figures)


def test_a_difference_is_claimed_only_with_all_seeds_and_apart():
    base = one((20.0, 20.1, 20.2), setting=BASE)
    assert verdict(one((20.3, 20.4, 20.5)), base) == "+0.30 dB, with every seed"
    assert verdict(one((20.1, 20.4, 20.5)), base) == "+0.30 dB, within the spread"
    assert verdict(one((19.0, 19.1, 19.2)), base) == "-1.00 dB, with every seed"
    assert verdict(one((25.0,)), base) == "+4.90 dB, no claim"
    assert verdict(base, base) == verdict(base, None) == ""


def test_seeds_come_together_step_by_step():
    runs = [Run(BASE, "capture", 1, 100, seed) for seed in SEEDS]
    records = {
        run.name: Record(
            {"psnr": 20.0 + i, "train_wall_seconds": 10.0 + i},
            "c",
            {},
            curve=(
                {"step": 50, "psnr": 15.0 + i, "train_wall_seconds": 4.0},
                {"step": 100, "psnr": 20.0 + i, "train_wall_seconds": 10.0 + i},
            ),
        )
        for i, run in enumerate(runs)
    }
    way, end = measured(runs, records)
    assert (way.done, way.psnr.median, way.is_final) == (50, 16.0, False)
    assert (end.done, end.psnr.least, end.psnr.most, end.seeds) == (100, 20.0, 22.0, 3)
    assert finals([way, end]) == [end]
    assert measured(runs, {}) == []


def test_the_front_holds_what_nothing_beats():
    found = [one((20.0,), 10.0), one((21.0,), 12.0), one((20.5,), 13.0), one((19.0,), 5.0)]
    assert on_front(found) == {0, 1, 3}


def test_time_and_quality_are_told_from_what_was_measured():
    found = [one((20.2,), 6.0), one((22.4,), 40.0), one((22.0,), 50.0)]
    best = best_within(45, found)
    assert best is not None and best.psnr.median == 22.4
    assert best_within(5, found) is None
    soonest = soonest_at(21, found)
    assert soonest is not None and soonest.wall.median == 40.0
    assert soonest_at(23, found) is None
    assert times_to_tell(found) == [10, 15, 30, 60]
    assert decibels_to_tell(found) == [21, 22]
