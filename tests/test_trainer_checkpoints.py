"""Which checkpoint a run goes on from and an evaluation loads, and which is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.utils import eval_utils

from desplat_ns.errors import CheckpointError, ConfigError
from desplat_ns.nerfstudio_quirks import load_evaluated_checkpoints_like_resumed_ones
from tests.helpers.stub_run import StubPipeline, StubPipelineConfig, resumed, set_up, train
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
    longer = resumed(config, timestamp="first", max_num_iterations=14)
    assert train(longer).pipeline.trained == [12, 13]


def test_a_second_run_of_the_same_name_replaces_nothing(config):
    train(config)
    saved = [config.get_base_dir() / "config.yml", *config.get_checkpoint_dir().iterdir()]
    before = [path.read_bytes() for path in saved]
    with pytest.raises(ConfigError, match="--timestamp"):
        set_up(dataclasses.replace(config, pipeline=StubPipelineConfig()))
    assert [path.read_bytes() for path in saved] == before
    longer = resumed(config, timestamp="first", max_num_iterations=14)
    assert train(longer).pipeline.trained == [12, 13]


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

    def test_loads_the_same_checkpoint(self, config, load):
        trained = train(config).pipeline
        pipeline = StubPipeline(StubPipelineConfig())
        assert load(pipeline)[1] == 11
        assert torch.equal(pipeline.groups["means"], trained.groups["means"])

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

    def test_takes_the_step_that_the_configuration_names(self, config, load):
        train(config)
        assert load(load_step=5)[1] == 5

    @pytest.mark.parametrize("exists", [True, False])
    def test_without_a_checkpoint_says_so(self, config, load, exists):
        if exists:
            config.get_checkpoint_dir().mkdir(parents=True)
        with pytest.raises(CheckpointError, match="nerfstudio_models"):
            load()
