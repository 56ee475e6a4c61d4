"""A run that is killed again and again loses the steps since its last save, and nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from lab.documents import CHECKOUT

KILLS = 20


@pytest.fixture(scope="module")
def report() -> dict:
    if not hasattr(os, "fork"):
        pytest.skip("kills forked processes, needs POSIX")
    command = [sys.executable, "-m", "lab.stability.kills", str(KILLS)]
    threads = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=1800,
        cwd=CHECKOUT,
        env=os.environ | threads,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_at_most_the_steps_since_the_last_save_are_lost(report: dict):
    assert len(report["kills"]) == KILLS
    for kill in report["kills"]:
        assert 0 <= kill["steps_done"] - kill["steps_kept"] <= report["steps_per_save"]
    assert sum(kill["training"] for kill in report["kills"]) >= KILLS // 2
    assert report["kills"][-1]["steps_kept"] > 0


@pytest.mark.slow
def test_every_checkpoint_loads_and_nothing_piles_up(report: dict):
    assert report["damaged"] == 0
    assert report["most_files"] <= 3  # the newest, the one before, one half written


@pytest.mark.slow
def test_it_ends_where_an_uninterrupted_run_ends(report: dict):
    assert report["same_bits"]
