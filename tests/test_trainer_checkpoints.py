"""Which checkpoint a run goes on from and an evaluation loads, and which is refused."""

from __future__ import annotations

import dataclasses

import pytest

from desplat_ns.errors import ConfigError
from tests.helpers.stub_run import StubPipelineConfig, resumed, set_up, train
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


def test_a_run_goes_on_from_the_one_before_a_truncated_newest_and_says_so(config, capsys):
    train(config)
    newest = config.get_checkpoint_dir() / "step-000000011.ckpt"
    newest.write_bytes(newest.read_bytes()[: newest.stat().st_size // 2])
    assert train(resumed(config)).pipeline.trained == [11]
    assert "step-000000011.ckpt" in " ".join(capsys.readouterr().out.split())
