"""The trainer on a stub pipeline: schedules of the run's length, exact resume, what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from nerfstudio.engine.optimizers import AdamOptimizerConfig
from nerfstudio.utils import writer

from desplat_ns.errors import BackendUnavailableError, CheckpointError, ConfigError
from desplat_ns.method_configs import desplat
from desplat_ns.trainer import DeSplatTrainerConfig
from desplat_ns.training.checkpoint import checkpoints_in, load_checkpoint
from tests.helpers.stub_run import (
    StubModelConfig,
    StubPipeline,
    StubPipelineConfig,
    assert_same,
    resumed,
    set_up,
    train,
)
from tests.helpers.stub_run import config as config


def test_a_resumed_run_equals_one_in_one_go_to_the_last_bit(config):
    train(config)
    straight = load_checkpoint(config.get_checkpoint_dir() / "step-000000011.ckpt")
    second = resumed(config, load_step=5)
    trainer = train(second, seed=99)
    assert trainer.pipeline.trained == list(range(6, 12))
    assert straight["optimizers"]["means"]["state"][0]["exp_avg"].abs().min() > 0
    assert_same(straight, load_checkpoint(second.get_checkpoint_dir() / "step-000000011.ckpt"))


def test_evaluation_on_the_way_does_not_change_the_training(config):
    def parameters(name: str, **changes: Any) -> torch.Tensor:
        run = dataclasses.replace(config, timestamp=name, **changes)
        trainer = set_up(run)
        trainer.pipeline.datamanager.eval_dataset = [0]
        trainer.train()
        return trainer.pipeline.groups["means"]

    often, never = parameters("often", steps_per_eval_image=2), parameters("never")
    assert torch.equal(often, never)


def test_the_number_of_steps_is_the_total_of_a_resumed_run(config):
    config.max_num_iterations = 6
    assert train(config).pipeline.trained == list(range(6))
    second = resumed(config, max_num_iterations=10)
    trainer = train(second)
    assert trainer.pipeline.trained == [6, 7, 8, 9]
    assert second.max_num_iterations == trainer.config.max_num_iterations == 10
    names = [path.name for path in checkpoints_in(second.get_checkpoint_dir())]
    assert names == ["step-000000009.ckpt"]


def test_a_short_run_goes_on_with_the_schedules_of_the_longer_one(config):
    rates: dict[str, list[float]] = {"long": [], "continued": []}

    def watched(config: DeSplatTrainerConfig, name: str) -> None:
        trainer = set_up(config)
        group = trainer.optimizers.optimizers["means"].param_groups[0]
        trainer.pipeline.at_step = lambda step: rates[name].append(group["lr"])
        trainer.train()

    watched(dataclasses.replace(config, timestamp="long", pipeline=StubPipelineConfig()), "long")
    train(dataclasses.replace(config, max_num_iterations=6, pipeline=StubPipelineConfig()))
    watched(resumed(config), "continued")
    # half the nominal number of steps: 1e-2 to 1e-4 over 12 steps
    assert rates["long"][6] == pytest.approx(1e-3, rel=1e-12)
    assert rates["continued"] == rates["long"][6:]


def test_rates_are_logged_with_the_other_figures_and_followed_in_every_step(config, monkeypatch):
    logged: dict[str, list[int]] = {}
    monkeypatch.setattr(
        writer, "put_scalar", lambda name, scalar, step: logged.setdefault(name, []).append(step)
    )
    config.logging.steps_per_log = 5
    followed: list[float] = []
    trainer = set_up(config)
    group = trainer.optimizers.optimizers["means"].param_groups[0]
    trainer.pipeline.at_step = lambda step: followed.append(group["lr"])
    trainer.train()
    assert logged["learning_rate/means"] == logged["Train Loss"] == [0, 5, 10]
    assert len(set(followed)) == len(followed) == 12


def test_rates_are_higher_while_few_photos_warm_up_and_a_resumed_run_knows(config):
    """Of 24 nominal steps, so of 12, the warm-up has 4 and would have 8: 2 and 4 of the run."""
    rates: list[list[float]] = []

    def watched(config: DeSplatTrainerConfig) -> None:
        trainer = set_up(config)
        groups = [o.param_groups[0] for o in trainer.optimizers.optimizers.values()]
        trainer.pipeline.at_step = lambda step: rates.append([g["lr"] for g in groups])
        trainer.train()

    def higher() -> StubPipelineConfig:
        return StubPipelineConfig(model=StubModelConfig(warmup=(4, 8)))

    decay = [1e-2 * 10 ** (-step / 6) for step in range(12)]
    factors = [2.0, 2.0, 2.0, 8 / 6] + 8 * [1.0]
    wanted = [[d * f, 1e-2 * f] for d, f in zip(decay, factors, strict=True)]
    watched(dataclasses.replace(config, timestamp="straight", pipeline=higher()))
    assert np.array(rates) == pytest.approx(np.array(wanted), rel=1e-12)
    rates.clear()
    train(dataclasses.replace(config, max_num_iterations=3, pipeline=higher()))
    watched(dataclasses.replace(resumed(config), pipeline=higher()))
    assert np.array(rates) == pytest.approx(np.array(wanted[3:]), rel=1e-12)


def test_the_options_of_a_resumed_run_set_its_rates(config):
    train(config)
    slower = {"optimizer": AdamOptimizerConfig(lr=1e-5, eps=1e-12), "scheduler": None}
    optimizers = {**config.optimizers, "scales": slower}
    second = dataclasses.replace(resumed(config), optimizers=optimizers)
    trainer = set_up(second)
    group = trainer.optimizers.optimizers["scales"].param_groups[0]
    assert (group["lr"], group["eps"]) == (1e-5, 1e-12)
    assert len(trainer.optimizers.optimizers["scales"].state) == 1  # the moments came along


def test_with_nothing_left_to_train_it_says_so_and_changes_nothing(config, capsys):
    train(config)
    before = {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()}
    same_folder = resumed(config, timestamp="first", max_num_iterations=12)
    assert train(same_folder).pipeline.trained == []
    assert {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()} == before
    said = " ".join(capsys.readouterr().out.split())
    assert "Nothing left to train" in said
    assert "give a larger --max-num-iterations" in said


def test_what_was_found_in_the_way_is_said_once_in_the_end(config, capsys):
    config.max_num_iterations = 3
    train(config)
    assert capsys.readouterr().out.count("Distractors in 1 of 5 photos: 3.png.") == 1


def test_a_run_goes_on_from_the_checkpoint_before_a_damaged_newest_one(config, capsys):
    """Saves are due after steps 5 and 10 and at the end, and by default two are kept."""
    config.save_only_latest_checkpoint = desplat.config.save_only_latest_checkpoint
    train(config)
    before, newest = checkpoints_in(config.get_checkpoint_dir())
    assert [before.name, newest.name] == ["step-000000010.ckpt", "step-000000011.ckpt"]
    newest.write_bytes(newest.read_bytes()[: newest.stat().st_size // 2])
    assert train(resumed(config)).pipeline.trained == [11]
    said = " ".join(capsys.readouterr().out.split())
    assert "step-000000011.ckpt is damaged" in said and "the newest intact one" in said


def test_a_run_that_cannot_be_set_up_leaves_no_folder(config, monkeypatch):
    """Nor does it touch the folder, and the config.yml, of the run that it was to go on with."""

    def fail(self: StubPipeline) -> Any:
        raise CheckpointError("it does not fit")

    config.output_dir = config.output_dir / "outputs"
    with monkeypatch.context() as patch:
        patch.setattr(StubPipeline, "get_param_groups", fail)
        config.save_config()  # as ns-train does
        with pytest.raises(CheckpointError, match="it does not fit"):
            set_up(config)
        assert not config.output_dir.exists()
    train(config)
    saved = contents(config.output_dir)
    again = resumed(config, timestamp=config.timestamp, steps_per_save=99)
    with monkeypatch.context() as patch:
        patch.setattr(StubPipeline, "get_param_groups", fail)
        again.save_config()
        with pytest.raises(CheckpointError, match="it does not fit"):
            set_up(again)
    assert contents(config.output_dir) == saved


def contents(folder: Path) -> dict[Path, bytes]:
    """Of all files but tensorboard's, which a thread of its own writes to the end."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path: path.read_bytes() for path in files if "tfevents" not in path.name}


def test_config_yml_holds_the_schedule_scale_that_was_resolved(config):
    set_up(config)
    text = (config.get_base_dir() / "config.yml").read_text()
    saved = yaml.load(text, Loader=yaml.Loader)
    assert saved.pipeline.model.schedule_scale == 0.5
    assert config.setup().config.pipeline.model.schedule_scale == 0.5


def test_a_schedule_scale_that_was_given_is_kept(config):
    config.pipeline.model.schedule_scale = 0.25
    trainer = set_up(config)
    assert trainer.config.pipeline.model.schedule_scale == 0.25
    scheduler = trainer.optimizers.schedulers["means"]
    assert isinstance(scheduler, torch.optim.lr_scheduler.LambdaLR)
    # the 24 nominal steps are over in 6: 1e-4 / 1e-2 is reached there, its root half way
    assert [scheduler.lr_lambdas[0](step) for step in (0, 3, 6, 7)] == pytest.approx(
        [1.0, 0.1, 0.01, 0.01], rel=1e-12
    )


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_schedule_scale_that_is_not_positive_is_refused(config, scale):
    config.pipeline.model.schedule_scale = scale
    with pytest.raises(ConfigError, match=r"--pipeline\.model\.schedule-scale"):
        config.setup()


@pytest.mark.parametrize("option", ["mixed_precision", "use_grad_scaler"])
def test_scaled_gradients_are_refused(config, option):
    setattr(config, option, True)
    with pytest.raises(ConfigError, match="--mixed-precision and --use-grad-scaler"):
        config.setup()


@pytest.mark.parametrize(("devices", "machines"), [(2, 1), (1, 2)])
def test_several_processes_are_refused_before_any_starts(config, devices, machines):
    """ns-train saves the configuration before it starts processes."""
    config.machine.num_devices, config.machine.num_machines = devices, machines
    for begin in (config.save_config, config.setup):
        with pytest.raises(ConfigError, match="for 2 processes; this method trains in one"):
            begin()
    assert not config.get_base_dir().exists()


def test_a_backend_that_cannot_run_is_said_before_anything_is_read(tiny_run, tmp_path: Path):
    config = tiny_run(tmp_path)
    config.machine.device_type, config.pipeline.model.backend = "cpu", "gsplat"
    trainer = config.setup(local_rank=0, world_size=1)
    with pytest.raises(BackendUnavailableError, match="Backend 'gsplat'"):
        trainer.setup()
    assert list(tmp_path.iterdir()) == []
