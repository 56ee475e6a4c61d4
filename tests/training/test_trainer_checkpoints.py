"""Which checkpoint a run goes on from and an evaluation loads, and which is refused."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.utils import eval_utils

from desplat_ns.core.checkpoint import checkpoints_in, load_checkpoint, step_of
from desplat_ns.core.errors import CheckpointError, ConfigError
from desplat_ns.plugin import load_evaluated_checkpoints_like_resumed_ones
from desplat_ns.training import trainer as trainer_module
from tests.helpers.stub_run import (
    StubPipeline,
    StubPipelineConfig,
    assert_same,
    resumed,
    set_up,
    train,
)
from tests.helpers.stub_run import config as config


def test_the_runs_folder_and_a_single_file_can_be_loaded(config):
    train(config)
    by_folder = set_up(resumed(config, load_dir=config.get_base_dir()))
    assert by_folder._start_step == 12
    file = config.get_checkpoint_dir() / "step-000000005.ckpt"
    by_file = set_up(resumed(config, timestamp="third", load_dir=None, load_checkpoint=file))
    assert by_file._start_step == 6


def test_two_trainings_never_share_a_runs_folder(config):
    trainer = set_up(config)
    with pytest.raises(ConfigError, match="at work"):
        set_up(dataclasses.replace(config, pipeline=StubPipelineConfig()))
    trainer.train()
    assert trainer.pipeline.trained == list(range(12))


def test_a_second_run_of_the_same_name_replaces_nothing(config):
    train(config)
    saved = [config.get_base_dir() / "config.yml", *config.get_checkpoint_dir().iterdir()]
    before = [path.read_bytes() for path in saved]
    with pytest.raises(ConfigError, match="--timestamp"):
        set_up(dataclasses.replace(config, pipeline=StubPipelineConfig()))
    assert [path.read_bytes() for path in saved] == before
    longer = resumed(config, timestamp="first", max_num_iterations=14)
    assert train(longer).pipeline.trained == [12, 13]


def test_going_on_from_an_older_step_replaces_nothing_that_was_trained_after_it(config):
    train(config)
    folder = config.get_checkpoint_dir()
    before = {path: path.read_bytes() for path in folder.iterdir()}
    older = resumed(config, load_step=5, max_num_iterations=14)
    for named in ({}, {"load_dir": None, "load_checkpoint": folder / "step-000000005.ckpt"}):
        with pytest.raises(ConfigError, match="--timestamp"):
            set_up(dataclasses.replace(older, timestamp="first", **named))
    assert train(older).pipeline.trained == list(range(6, 14))  # in a folder of its own
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    for path in before:
        if path.name != "step-000000005.ckpt":
            path.write_bytes(b"damaged")
    again = dataclasses.replace(older, timestamp="first", load_step=None)
    assert train(again).pipeline.trained == list(range(6, 14))


@pytest.fixture
def hands(monkeypatch) -> list[float]:
    """What the trainer's clock shows, in seconds, in a list of one."""
    now = [0.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], time=time.time)
    monkeypatch.setattr(trainer_module, "time", clock)
    return now


def train_by_the_clock(config: Any, hands: list[float], seconds: float) -> list[Path]:
    """The checkpoints of a run, none of which is due by its number of steps."""
    config.steps_per_save = 1000
    trainer = set_up(config)
    trainer.pipeline.at_step = lambda step: hands.__setitem__(0, hands[0] + seconds)
    trainer.train()
    return checkpoints_in(config.get_checkpoint_dir())


def test_a_run_saves_when_minutes_have_passed_and_goes_on_from_there_to_the_bit(config, hands):
    """After five steps of a minute each, and five more; step 11 is the last."""
    saved = train_by_the_clock(config, hands, 60)
    assert [step_of(path) for path in saved] == [4, 9, 11]
    second = resumed(config, load_step=4)
    assert train(second, seed=99).pipeline.trained == list(range(5, 12))
    folders = config.get_checkpoint_dir(), second.get_checkpoint_dir()
    straight, again = (load_checkpoint(folder / saved[-1].name) for folder in folders)
    assert straight["optimizers"]["means"]["state"][0]["exp_avg"].abs().min() > 0
    assert_same(straight, again)


def test_slow_saves_take_a_small_share_of_the_time(config, hands, monkeypatch):
    """A minute a step and half a minute a save: the second is due 25 minutes after the first."""
    save = trainer_module.save_atomically

    def slow(*args: Any) -> None:
        hands[0] += 30
        save(*args)

    monkeypatch.setattr(trainer_module, "save_atomically", slow)
    config.max_num_iterations = 40
    saved = train_by_the_clock(config, hands, 60)
    assert [step_of(path) for path in saved] == [4, 29, 39]


class TestEvaluation:
    """`ns-eval`, `ns-render`, `ns-viewer` and `ns-export` load by nerfstudio's function."""

    @pytest.fixture
    def load(self, config) -> Callable[..., tuple[Path, int]]:
        load_evaluated_checkpoints_like_resumed_ones()

        def load(pipeline: Any = None, **changes: Any) -> tuple[Path, int]:
            run = resumed(config, timestamp="first", **changes)
            pipeline = pipeline or StubPipeline(StubPipelineConfig())
            return eval_utils.eval_load_checkpoint(run, pipeline)

        return load

    def test_loads_the_same_checkpoint_or_that_of_the_step_that_is_named(self, config, load):
        trained = train(config).pipeline
        pipeline = StubPipeline(StubPipelineConfig())
        assert load(pipeline)[1] == 11
        assert torch.equal(pipeline.groups["means"], trained.groups["means"])
        assert load(load_step=5)[1] == 5

    @pytest.mark.parametrize("left", [0, 0.5])
    def test_takes_the_one_before_a_truncated_newest_and_says_so(self, config, load, left, capsys):
        train(config)
        newest = config.get_checkpoint_dir() / "step-000000011.ckpt"
        whole = newest.read_bytes()
        newest.write_bytes(whole[: int(left * len(whole))])
        path, step = load()
        assert (path.name, step) == ("step-000000010.ckpt", 10)
        assert "step-000000011.ckpt" in " ".join(capsys.readouterr().out.split())
        assert train(resumed(config)).pipeline.trained == [11]

    @pytest.mark.parametrize("exists", [True, False])
    def test_without_a_checkpoint_says_so(self, config, load, exists):
        if exists:
            config.get_checkpoint_dir().mkdir(parents=True)
        with pytest.raises(CheckpointError, match="nerfstudio_models"):
            load()
