"""The trainer on a stub pipeline: schedules of the run's length, exact resume, clean stops."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from nerfstudio.engine.optimizers import AdamOptimizerConfig
from nerfstudio.utils import eval_utils

from desplat_ns.errors import CheckpointError, ConfigError
from desplat_ns.nerfstudio_quirks import load_evaluated_checkpoints_like_resumed_ones
from desplat_ns.trainer import DeSplatTrainerConfig
from desplat_ns.training.checkpoint_files import STAGING_FOLDER, checkpoints_in, load_checkpoint
from tests.helpers.stub_run import (
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


def test_only_the_latest_checkpoint_stays_when_asked(config):
    config.save_only_latest_checkpoint = True
    train(config)
    assert [p.name for p in config.get_checkpoint_dir().iterdir()] == ["step-000000011.ckpt"]


def test_a_run_that_cannot_be_set_up_leaves_no_folder(config, monkeypatch):
    """Nor does it touch the folder, and the config.yml, of an earlier run of the same name."""

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
    saved = {p: p.read_bytes() for p in config.output_dir.rglob("*") if p.is_file()}
    config.steps_per_save = 99
    with monkeypatch.context() as patch:
        patch.setattr(StubPipeline, "get_param_groups", fail)
        config.save_config()
        with pytest.raises(CheckpointError, match="it does not fit"):
            set_up(config)
    assert {p: p.read_bytes() for p in config.output_dir.rglob("*") if p.is_file()} == saved


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
    # 24 steps become 6: 1e-4 / 1e-2 is reached there, its root half way
    assert [scheduler.lr_lambdas[0](step) for step in (0, 3, 6, 7)] == pytest.approx(
        [1.0, 0.1, 0.01, 0.01], rel=1e-12
    )


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_schedule_scale_that_is_not_positive_is_refused(config, scale):
    config.pipeline.model.schedule_scale = scale
    with pytest.raises(ConfigError, match=r"--pipeline\.model\.schedule-scale"):
        config.setup()


def test_a_run_told_to_stop_saves_the_step_it_finished(config):
    trainer = set_up(config)

    def stop_at_7(step: int) -> None:
        trainer.stop_training = step == 7

    trainer.pipeline.at_step = stop_at_7
    trainer.train()
    assert trainer.pipeline.trained == list(range(8))
    newest = checkpoints_in(config.get_checkpoint_dir())[-1]
    assert newest.name == "step-000000007.ckpt"
    second = resumed(config)
    assert train(second).pipeline.trained == [8, 9, 10, 11]


@pytest.mark.parametrize("stopped", [False, True])
def test_what_was_cleared_away_is_swept_at_the_end_of_a_run_and_not_where_it_is_only_stopped(
    config, stopped
):
    """Before its last checkpoint. What a stopped run saves has to go on as if it had not been."""
    trainer, swept = set_up(config), []
    trainer.pipeline.model.sweep = lambda: swept.append(len(checkpoints_in(trainer.checkpoint_dir)))

    def tell_it(step: int) -> None:
        trainer.stop_training = stopped and step == 7

    trainer.pipeline.at_step = tell_it
    trainer.train()
    assert swept == ([] if stopped else [2])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_step_saves_and_nothing_is_lost(config, number):
    train(dataclasses.replace(config, timestamp="straight", pipeline=StubPipelineConfig()))
    trainer = set_up(config)
    handler = signal.getsignal(number)
    trainer.pipeline.at_step = lambda step: os.kill(os.getpid(), number) if step == 3 else None
    trainer.train()
    assert trainer.pipeline.trained == [0, 1, 2, 3]
    assert checkpoints_in(config.get_checkpoint_dir())[-1].name == "step-000000003.ckpt"
    assert signal.getsignal(number) is handler
    second = resumed(config)
    assert train(second, seed=99).pipeline.trained == list(range(4, 12))
    straight = config.get_base_dir().parent / "straight" / "nerfstudio_models"
    assert_same(
        load_checkpoint(straight / "step-000000011.ckpt"),
        load_checkpoint(second.get_checkpoint_dir() / "step-000000011.ckpt"),
    )


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
    with pytest.raises(KeyboardInterrupt):
        trainer.train()
    assert trainer.pipeline.trained == []
    assert not config.get_checkpoint_dir().exists()


def test_a_damaged_newest_checkpoint_resumes_from_the_one_before(config):
    train(config)
    newest = config.get_checkpoint_dir() / "step-000000011.ckpt"
    newest.write_bytes(newest.read_bytes()[:1000])
    assert train(resumed(config)).pipeline.trained == [11]


def test_the_runs_folder_and_a_single_file_can_be_loaded(config):
    train(config)
    by_folder = set_up(resumed(config, load_dir=config.get_base_dir()))
    assert by_folder._start_step == 12
    file = config.get_checkpoint_dir() / "step-000000005.ckpt"
    by_file = set_up(resumed(config, load_dir=None, load_checkpoint=file))
    assert by_file._start_step == 6


def test_a_checkpoint_with_other_groups_is_refused_and_unharmed(config):
    train(config)
    before = {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()}
    second = resumed(config)
    second.pipeline = StubPipelineConfig(groups=("means", "scales", "extra"))
    trainer = second.setup()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StubPipeline, "load_pipeline", lambda *_: None)
        with pytest.raises(CheckpointError, match=r"no optimizer state for extra.*effects"):
            trainer.setup()
    assert {p: p.read_bytes() for p in config.get_checkpoint_dir().iterdir()} == before


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

    @pytest.mark.parametrize("left", [0, 1, 0.5, -1])
    def test_takes_the_one_before_a_truncated_newest_and_says_so(self, config, load, left, capsys):
        train(config)
        newest = config.get_checkpoint_dir() / "step-000000011.ckpt"
        whole = newest.read_bytes()
        newest.write_bytes(whole[: int(left * len(whole)) if left == 0.5 else left])
        path, step = load()
        assert (path.name, step) == ("step-000000010.ckpt", 10)
        said = " ".join(capsys.readouterr().out.split())
        assert "step-000000011.ckpt is damaged" in said
        assert "Going on from" in said

    def test_takes_the_step_that_the_configuration_names(self, config, load):
        train(config)
        assert load(load_step=5)[1] == 5

    @pytest.mark.parametrize("exists", [True, False])
    def test_without_a_checkpoint_says_so(self, config, load, exists):
        if exists:
            config.get_checkpoint_dir().mkdir(parents=True)
        with pytest.raises(CheckpointError, match=r"nerfstudio_models.* (is empty|does not exist)"):
            load()


@contextmanager
def full_disk(room: int) -> Iterator[None]:
    """Within, no file can become larger than `room` bytes."""
    resource = pytest.importorskip("resource", reason="needs a file size limit to fill the disk")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # the log's
def test_a_save_that_fails_on_the_way_costs_no_step(config, capsys):
    """Saves are due after steps 5 and 10 and at the end; the disk is full at 10."""
    trainer = set_up(config)
    with ExitStack() as stack:

        def fill(step: int) -> None:
            if step == 8:
                stack.enter_context(full_disk(1000))
            elif step == 11:
                stack.close()

        trainer.pipeline.at_step = fill
        trainer.train()
    assert trainer.pipeline.trained == list(range(12))
    names = [path.name for path in checkpoints_in(config.get_checkpoint_dir())]
    assert names == ["step-000000005.ckpt", "step-000000011.ckpt"]
    said = " ".join(capsys.readouterr().out.split())
    assert "step-000000010.ckpt could not be written" in said
    assert "Training goes on; the next try is in 5 steps" in said
    assert "Nothing more is logged to files" in said


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # the log's
def test_a_last_save_that_fails_ends_the_run_with_its_reason(config, capsys):
    trainer = set_up(config)
    with ExitStack() as stack:
        trainer.pipeline.at_step = lambda step: (
            stack.enter_context(full_disk(1000)) if step == 8 else None
        )
        with pytest.raises(CheckpointError, match=r"000011.ckpt could not be .*Free some space"):
            trainer.train()  # capsys: what is printed goes to memory, which is not full
    assert [p.name for p in config.get_base_dir().glob("nerfstudio_models/*")] == [
        "step-000000005.ckpt"
    ]
    assert not (config.get_base_dir() / STAGING_FOLDER).exists()
    assert train(resumed(config)).pipeline.trained == list(range(6, 12))


@pytest.mark.parametrize(("devices", "machines"), [(2, 1), (1, 2)])
def test_several_processes_are_refused_before_any_starts(config, devices, machines):
    """ns-train saves the configuration before it starts processes."""
    config.machine.num_devices, config.machine.num_machines = devices, machines
    for begin in (config.save_config, config.setup):
        with pytest.raises(ConfigError, match="for 2 processes; this method trains in one"):
            begin()
    assert not config.get_base_dir().exists()
