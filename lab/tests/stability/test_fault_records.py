"""A leak is found in what a long run measured, and what was lost shows in the page."""

from __future__ import annotations

import pytest

from lab.stability import soak
from lab.stability.fault_tables import kill_figures, soak_figures
from lab.stability.soak import Sample, Soak


def run_of(growth: float, noise: float = 0.0) -> Soak:
    """60 samples of a process that grows by so many KiB per step once it has settled."""
    samples = []
    for i in range(1, 61):
        step = soak.EVERY * i
        rss = 900 + growth * max(0, step - 10_000) / 1024 + noise * (-1) ** i
        samples.append(Sample(step, rss, 1, 1, 1, 1.0))
    return Soak({}, samples)


def test_growth_is_measured_where_the_run_has_settled():
    assert run_of(0.5).slope == pytest.approx(0.5)
    assert run_of(0.5).growth == pytest.approx(0.5 * 20_000 / 1024)
    assert run_of(0.5).settled[0].step == 10_000


def test_a_leak_of_one_number_per_gaussian_and_step_would_be_found():
    assert not run_of(300 * 4 / 1024).flat
    assert run_of(0.9).flat
    assert run_of(0.0, noise=5).flat


def test_a_jump_that_stays_is_not_flat():
    run = run_of(0.0)
    late = [Sample(s.step, s.rss + 25, 1, 1, 1, 1.0) for s in run.samples[-3:]]
    assert not Soak({}, run.samples[:-3] + late).flat


def test_what_is_not_as_promised_shows_in_the_page():
    kill = {"training": True, "steps_done": 9, "steps_kept": 4, "while_saving": False}
    killed = {"kills": [kill], "steps": 20, "steps_per_save": 2, "damaged": 1, "most_files": 2}
    figures = kill_figures({**killed, "same_bits": False})
    assert figures["most_lost"] == "5"
    assert "| 5 |" in figures["kills"]
    assert figures["kill_bits"] == "NOT to the last bit"
    assert "NOT flat" in soak_figures(run_of(3.0))["soak_verdict"]
