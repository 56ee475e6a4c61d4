"""The page of results says what the records say."""

from __future__ import annotations

from lab.grid.records import Record
from lab.grid.runs import Run
from lab.reproduce.results import HEAD, rows_of
from lab.separation.runs import STUDY


def record(psnr: float, commit: str) -> Record:
    figures = {"psnr": psnr, "num_static_gaussians": 1000, "train_cpu_seconds": 50.4}
    return Record(figures, commit)


def test_a_row_has_medians_time_memory_and_the_commits_of_its_seeds():
    records = {
        Run("desplat", "clutter", 2, 3000, 42): record(20.0, "a" * 40),
        Run("desplat", "clutter", 2, 3000, 43): record(23.0, "b" * 40),
        Run("desplat", "clutter", 2, 3000, 44): record(21.0, "a" * 40),
        Run("off", "clean", 2, 1000, 42): record(30.0, "c" * 40),
    }
    ours, twins = rows_of(STUDY, records)
    assert len(ours) == len(HEAD)
    assert ours[1:4] == ["**`desplat`**", "3,000", "3"]
    assert ours[4:] == ["21.00", "", "50", "0.2", "", "aaaaaaa, bbbbbbb"]
    assert (twins[1], twins[-1]) == ("distractors off, clean twins", "ccccccc")
    assert twins[0] == ours[0], "clean photos of the same capture"
