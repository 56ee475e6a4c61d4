"""A run told to stop saves what it finished and can go on; a second Ctrl+C ends it at once."""

import dataclasses
import os
import signal
from pathlib import Path

import pytest
import torch

from desplat_ns.core.checkpoint import checkpoints_in, load_checkpoint
from desplat_ns.training import trainer as trainer_module
from desplat_ns.training.stop_signals import STOP_SIGNALS
from tests.helpers.stub_run import StubPipelineConfig, assert_same, resumed, set_up, train
from tests.helpers.stub_run import config as config


def test_an_evaluation_that_fails_ends_the_run_and_what_is_trained_is_saved(config, monkeypatch):
    monkeypatch.setattr(config, "steps_per_eval_all_images", 3)
    trainer = set_up(config)
    trainer.pipeline.datamanager.eval_dataset = ["a.jpg"]

    def fail(**_: object) -> None:
        torch.rand(1)
        raise MemoryError("no room for the metric")

    monkeypatch.setattr(trainer.pipeline, "get_average_eval_image_metrics", fail)
    with pytest.raises(MemoryError):
        trainer.train()
    assert trainer.pipeline.trained == [0, 1, 2, 3]
    assert checkpoints_in(config.get_checkpoint_dir())[-1].name == "step-000000003.ckpt"
    second = resumed(config, steps_per_eval_all_images=0)
    assert train(second).pipeline.trained == list(range(4, 12))


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_signal_finishes_the_step_saves_and_nothing_is_lost(config, number):
    handler = signal.getsignal(number)
    if handler is signal.SIG_IGN:
        pytest.skip(f"{signal.Signals(number).name} is ignored here, as under nohup")
    train(dataclasses.replace(config, timestamp="straight", pipeline=StubPipelineConfig()))
    assert signal.getsignal(number) is handler
    trainer = set_up(config)
    trainer.pipeline.at_step = lambda step: os.kill(os.getpid(), number) if step == 3 else None
    trainer.train()
    assert trainer.pipeline.trained == [0, 1, 2, 3]
    assert checkpoints_in(config.get_checkpoint_dir())[-1].name == "step-000000003.ckpt"
    assert signal.getsignal(number) is handler
    second = resumed(config)
    assert train(second, seed=99).pipeline.trained == list(range(4, 12))
    straight = config.get_base_dir().parent / "straight" / "nerfstudio_models"
    folders = straight, second.get_checkpoint_dir()
    assert_same(*(load_checkpoint(folder / "step-000000011.ckpt") for folder in folders))


@pytest.fixture
def python_handles_sigint():
    """What an interactive shell gives; a job started in the background ignores the signal."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_second_ctrl_c_ends_the_run_at_once(config, python_handles_sigint):
    trainer = set_up(config)

    def twice(step: int) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    trainer.pipeline.at_step = twice
    with pytest.raises(SystemExit, match="130"):
        trainer.train()
    assert trainer.pipeline.trained == []
    assert not config.get_checkpoint_dir().exists()


def test_ctrl_c_twice_during_the_last_save_is_no_success_and_says_what_is_saved(
    config, python_handles_sigint, monkeypatch, capsys
):
    trainer, save = set_up(config), trainer_module.save_atomically

    def interrupted(state: dict, path: Path) -> None:
        if state["step"] == 7:
            os.kill(os.getpid(), signal.SIGINT)
        save(state, path)

    def stop_at_7(step: int) -> None:
        if step == 7:
            os.kill(os.getpid(), signal.SIGINT)

    trainer.pipeline.at_step = stop_at_7
    monkeypatch.setattr(trainer_module, "save_atomically", interrupted)
    with pytest.raises(SystemExit, match="130"):
        trainer.train()
    assert [path.name for path in config.get_checkpoint_dir().iterdir()] == ["step-000000005.ckpt"]
    said = capsys.readouterr().out
    assert "6 steps are saved" in said and f"--load-dir {config.get_checkpoint_dir()}\n" in said
