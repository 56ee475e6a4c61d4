"""A run that is killed again and again loses the steps since its last save, and nothing else."""

from __future__ import annotations

import os

import pytest

from lab.stability.kills import KILLS, MOST_FILES, STEPS_PER_SAVE, in_a_process


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes, needs POSIX")
def test_a_kill_loses_the_steps_since_the_last_save_and_nothing_else():
    found = in_a_process()
    assert len(found["kills"]) == KILLS
    for _, done, kept in found["kills"]:
        assert 0 <= done - kept <= STEPS_PER_SAVE
    assert sum(has_trained for has_trained, _, _ in found["kills"]) >= KILLS // 2
    assert found["kills"][-1][2] > 0
    assert found["damaged"] == 0
    assert found["most_files"] <= MOST_FILES
    assert found["same_bits"]
