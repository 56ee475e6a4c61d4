"""The page of results says what the records say."""

from __future__ import annotations

from lab.grid.records import Record
from lab.reproduce.results import HEAD, rows_of


def record(psnr: float, commit: str | None) -> Record:
    figures = {"psnr": psnr, "num_static_gaussians": 1000, "train_cpu_seconds": 50.4}
    return Record(figures, commit, None)


def test_a_row_has_medians_time_memory_and_the_commits_of_its_seeds():
    records = {
        "desplat-clutter-2-3000-42": record(20.0, "a" * 40),
        "desplat-clutter-2-3000-43": record(23.0, "b" * 40),
        "desplat-clutter-2-3000-44": record(21.0, "a" * 40),
        "off-clean-2-1000-42": record(30.0, None),
        "lambda-paper-clutter-2-3000-42": record(10.0, None),
    }
    (_, ours), (steps, twins) = rows_of(records)
    assert len(ours) == len(HEAD)
    assert ours[1:] == ["**`desplat`**", "3", "21.00", "", "50", "0.2", "", "aaaaaaa, bbbbbbb"]
    assert (steps, twins[1], twins[-1]) == (1000, "distractors off, clean twins", "not recorded")
    assert twins[0] == ours[0], "clean photos of the same capture"
