"""The trainer on a stub pipeline: schedules of a run's length, resuming, what is refused."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desplat_ns.core.errors import BackendUnavailableError, CheckpointError, ConfigError
from desplat_ns.training.trainer import DeSplatTrainerConfig
from tests.helpers.stub_run import (
    StubModelConfig,
    StubPipeline,
    StubPipelineConfig,
    resumed,
    set_up,
    train,
)
from tests.helpers.stub_run import config as config


def rates_of(config: DeSplatTrainerConfig) -> list[list[float]]:
    """At each step of a run those of all groups, `means` before those that are constant."""
    trainer, rates = set_up(config), list[list[float]]()
    groups = [o.param_groups[0] for o in trainer.optimizers.optimizers.values()]
    trainer.pipeline.at_step = lambda step: rates.append([g["lr"] for g in groups])
    trainer.train()
    return rates


def test_a_short_run_goes_on_with_the_schedules_of_the_longer_one(config):
    long = rates_of(dataclasses.replace(config, timestamp="long", pipeline=StubPipelineConfig()))
    train(dataclasses.replace(config, max_num_iterations=6, pipeline=StubPipelineConfig()))
    # half the nominal number of steps: 1e-2 to 1e-4 over 12 steps
    assert long[6][0] == pytest.approx(1e-3, rel=1e-12)
    assert rates_of(resumed(config)) == long[6:]


def test_a_run_that_is_cut_short_goes_through_what_is_left_of_its_schedules(config, capsys):
    """Of 24 nominal steps, 12 of the run, 3 are done: the other 18 nominal ones are done in 3."""
    paced = StubPipelineConfig(model=StubModelConfig(schedule_scale=0.5))
    train(dataclasses.replace(config, max_num_iterations=3, pipeline=paced))
    rates = rates_of(resumed(config, max_num_iterations=6))
    wanted = [1e-2 * 10 ** (-n / 12) for n in (6, 12, 18)]
    assert [of[0] for of in rates] == pytest.approx(wanted, rel=1e-12)
    assert "planned for more steps" in capsys.readouterr().out


def test_rates_are_higher_while_few_photos_warm_up_and_a_resumed_run_knows(config):
    """Of 24 nominal steps, so of 12, the warm-up has 4 and would have 8: 2 and 4 of the run."""

    def higher() -> StubPipelineConfig:
        return StubPipelineConfig(model=StubModelConfig(warmup=(4, 8)))

    decay = [1e-2 * 10 ** (-step / 6) for step in range(12)]
    factors = [2.0, 2.0, 2.0, 8 / 6] + 8 * [1.0]
    wanted = [[d * f, 1e-2 * f] for d, f in zip(decay, factors, strict=True)]
    rates = rates_of(dataclasses.replace(config, timestamp="straight", pipeline=higher()))
    assert np.array(rates) == pytest.approx(np.array(wanted), rel=1e-12)
    train(dataclasses.replace(config, max_num_iterations=3, pipeline=higher()))
    rates = rates_of(dataclasses.replace(resumed(config), pipeline=higher()))
    assert np.array(rates) == pytest.approx(np.array(wanted[3:]), rel=1e-12)


def test_with_nothing_left_to_train_it_says_so_and_changes_nothing(config, capsys):
    train(config)
    before = {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()}
    same_folder = resumed(config, timestamp="first", max_num_iterations=12)
    assert train(same_folder).pipeline.trained == []
    assert {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()} == before
    assert "--max-num-iterations" in capsys.readouterr().out


def test_a_run_that_cannot_be_set_up_leaves_no_folder(config, monkeypatch):
    """Nor does it touch the folder, and the config.yml, of the run that it was to go on with."""

    def fail(self: StubPipeline) -> Any:
        raise CheckpointError("it does not fit")

    config.output_dir = config.output_dir / "outputs"
    with monkeypatch.context() as patch:
        patch.setattr(StubPipeline, "get_param_groups", fail)
        config.save_config()  # as ns-train does
        with pytest.raises(CheckpointError):
            set_up(config)
        assert not config.output_dir.exists()
    train(config)
    saved = contents(config.output_dir)
    again = resumed(config, timestamp=config.timestamp, steps_per_save=99)
    with monkeypatch.context() as patch:
        patch.setattr(StubPipeline, "get_param_groups", fail)
        again.save_config()
        with pytest.raises(CheckpointError):
            set_up(again)
    assert contents(config.output_dir) == saved


def contents(folder: Path) -> dict[Path, bytes]:
    """Of all files but tensorboard's, which a thread of its own writes to the end."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path: path.read_bytes() for path in files if "tfevents" not in path.name}


@pytest.mark.parametrize("option", ["mixed_precision", "use_grad_scaler"])
def test_scaled_gradients_are_refused(config, option):
    setattr(config, option, True)
    with pytest.raises(ConfigError, match="--mixed-precision"):
        config.setup()


@pytest.mark.parametrize(("devices", "machines"), [(2, 1), (1, 2)])
def test_several_processes_are_refused_before_any_starts(config, devices, machines):
    """ns-train saves the configuration before it starts processes."""
    config.machine.num_devices, config.machine.num_machines = devices, machines
    for begin in (config.save_config, config.setup):
        with pytest.raises(ConfigError, match="several processes"):
            begin()
    assert not config.get_base_dir().exists()


def test_a_backend_that_cannot_run_is_said_before_anything_is_read(tiny_run, tmp_path: Path):
    config = tiny_run(tmp_path)
    config.machine.device_type, config.pipeline.model.backend = "cpu", "gsplat"
    trainer = config.setup(local_rank=0, world_size=1)
    with pytest.raises(BackendUnavailableError, match="gsplat"):
        trainer.setup()
    assert list(tmp_path.iterdir()) == []


def test_what_a_step_gives_to_be_logged_has_no_gradient(config):
    trainer = set_up(config)
    trainer.stop_training = False  # as nerfstudio's loop does
    loss, terms, _ = trainer.train_iteration(0)
    assert not any(value.requires_grad for value in (loss, *terms.values()))
