"""What a run says of its time, and that to find it out changes nothing of the run."""

import re
from types import SimpleNamespace
from typing import Any

import pytest

from desplat_ns.core import console
from desplat_ns.core.checkpoint import load_newest
from desplat_ns.core.schedule import seconds_of
from desplat_ns.training import clock
from desplat_ns.training import trainer as trainer_module
from desplat_ns.training.pipeline import DeSplatPipeline
from tests.helpers.registered import set_up
from tests.helpers.stub_run import assert_same

SECONDS = 10.1


@pytest.fixture
def timed(tiny_run, tmp_path, monkeypatch) -> Any:
    """Trains the tiny scene after trial steps, each step in `SECONDS` of a clock of its own."""
    now = [0.0]
    losses = DeSplatPipeline.get_train_loss_dict

    def slow_losses(self: Any, step: int) -> Any:
        now[0] += SECONDS
        return losses(self, step)

    def train(folder: str) -> Any:
        trainer = set_up(tiny_run(tmp_path / folder), 1)
        trainer.train()
        return load_newest(trainer.checkpoint_dir)[1]

    clock_of_its_own = SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr(trainer_module, "time", clock_of_its_own)
    monkeypatch.setattr(console, "time", clock_of_its_own)
    monkeypatch.setattr(trainer_module, "process_started", lambda: 0.0)
    monkeypatch.setattr(trainer_module, "TIMED_FROM", 1)
    monkeypatch.setattr(DeSplatPipeline, "get_train_loss_dict", slow_losses)
    for price in ("GAUSSIAN", "LAYER", "LOOK"):  # as much as thousands of such photos
        monkeypatch.setattr(clock, price, 0)
    return train


def test_trial_steps_change_no_bit_and_time_is_told_each_minute(timed, monkeypatch, capsys):
    monkeypatch.setattr(console, "TOLD_FROM", 60.0)
    with_trial, said = timed("timed"), capsys.readouterr().out
    assert "About 4 min on this machine for 24 steps." in said
    told = re.findall(r"Step (\d+) of 24, about (.*) left", said)
    assert [int(step) for step, _ in told] == [6, 12, 18]
    for step, left in told:
        assert seconds_of(left) == pytest.approx(SECONDS * (24 - int(step)), abs=15)
    monkeypatch.setattr(trainer_module, "TIMED_FROM", 10**9)
    without = timed("untimed")
    for state in (with_trial, without):
        del state["rng"]["python"]  # the checks of types in tests draw from it: there are more
    assert_same(with_trial, without)
