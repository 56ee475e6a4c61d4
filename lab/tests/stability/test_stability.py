"""A case beyond its bound, a leak and a broken line that nobody notices are found."""

import os

import pytest

from lab.stability import catalogue, kills
from lab.stability.catalogue import CASES
from lab.stability.mutations import noticed_by
from lab.stability.soak import EVERY, Sample, verdict


@pytest.mark.slow
def test_the_catalogue_has_a_row_for_each_case_and_finds_the_one_beyond_its_bound(monkeypatch):
    text, is_kept = catalogue.measured(CASES[:2])
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + 2 and is_kept
    run = catalogue.run

    def beyond(*arguments):
        outcome = run(*arguments)
        outcome.share = 1.5
        return outcome

    monkeypatch.setattr(catalogue, "run", beyond)
    assert not catalogue.measured(CASES[:1])[1]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes, needs POSIX")
def test_a_kill_loses_the_steps_since_the_last_save_and_nothing_else():
    text, is_kept = kills.measured()
    assert is_kept, text


def run_of(growth: float, jump: float = 0.0) -> list[Sample]:
    """A process that grows by `growth` KiB per step after a third of its run, and jumps in the
    end."""
    steps = range(EVERY, 60 * EVERY + 1, EVERY)
    late = 57 * EVERY
    return [
        Sample(s, 900 + growth * max(0, s - 20 * EVERY) / 1024 + jump * (s > late)) for s in steps
    ]


@pytest.mark.parametrize(
    ("samples", "is_flat"),
    [
        (run_of(0.0), True),
        (run_of(0.9), True),
        (run_of(300 * 4 / 1024), False),
        (run_of(0.0, 25), False),
    ],
    ids=["flat", "less than one number per Gaussian", "one number per Gaussian", "a jump"],
)
def test_a_leak_of_one_number_per_gaussian_and_step_is_found(samples, is_flat: bool):
    text, verdict_is_flat = verdict(samples)
    assert verdict_is_flat == is_flat
    assert ("NOT flat" in text) != is_flat


@pytest.mark.slow
def test_what_fails_is_named_and_what_passes_is_not(tmp_path):
    (tmp_path / "test_one.py").write_text("def test_sum():\n    assert 1 + 1 == 3\n")
    (tmp_path / "test_two.py").write_text("def test_sum():\n    assert 1 + 1 == 2\n")
    assert noticed_by("test_one.py", tmp_path) == ("test_one.py::test_sum", True)
    assert noticed_by("test_two.py", tmp_path) == ("NOBODY", False)
    assert "NOT TRIED" in noticed_by("nowhere.py", tmp_path)[0]
