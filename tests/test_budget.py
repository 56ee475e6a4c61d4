"""`ns-train desplat --budget`: the first steps plan it, the clock keeps it, nothing is lost."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import pytest
import torch
import yaml
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackLocation

from desplat_ns.core.checkpoint import load_newest
from desplat_ns.core.errors import ConfigError
from desplat_ns.training import clock as trainer_clock
from desplat_ns.training import trainer as trainer_module
from desplat_ns.training.datamanager import DeSplatDataManager
from desplat_ns.training.pipeline import DeSplatPipeline
from tests.helpers import registered

BUDGET = 24


@pytest.fixture
def clock(monkeypatch) -> SimpleNamespace:
    """A clock that goes on where photos are drawn, by what its size costs, and by what photos take
    to load: some 30 steps fit, 20 of them planned."""
    clock = SimpleNamespace(now=0.0, fixed=0.5, pixels=0.2, loading=2.0, compiling=0.0)

    def compile_kernels(*_: Any) -> float:
        clock.now += clock.compiling
        return clock.compiling

    monkeypatch.setattr(trainer_module, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(trainer_module, "process_started", lambda: 0.0)
    monkeypatch.setattr(trainer_module, "compile_kernels", compile_kernels)
    monkeypatch.setattr(trainer_module, "END_SECONDS", 0.5)
    for price in ("GAUSSIAN", "LAYER", "LOOK"):
        monkeypatch.setattr(trainer_clock, price, 0)
    monkeypatch.setattr(trainer_module, "FEWEST_STEPS", 12)  # photos and runs are tiny
    monkeypatch.setattr(trainer_module, "STEPS_WANTED", 16)
    losses, load = DeSplatPipeline.get_train_loss_dict, DeSplatDataManager._load_images

    def slow_losses(self: Any, step: int) -> Any:
        model = self.model
        reduction = model.config.downscale_factor(model.nominal_step, 1)
        clock.now += clock.fixed + clock.pixels / reduction**2
        return losses(self, step)

    def slow_load(self: Any, split: Any, *args: Any, **kwargs: Any) -> Any:
        clock.now += clock.loading if split == "train" else 0.0
        return load(self, split, *args, **kwargs)

    monkeypatch.setattr(DeSplatPipeline, "get_train_loss_dict", slow_losses)
    monkeypatch.setattr(DeSplatDataManager, "_load_images", slow_load)
    return clock


@pytest.fixture
def config(tiny_run, tmp_path) -> Any:
    config = tiny_run(tmp_path)
    config.budget, config.max_num_iterations = f"{BUDGET}s", 30_000
    return config


def set_up(config: Any, **changes: Any) -> Any:
    return registered.set_up(dataclasses.replace(config, **changes))


def train(config: Any, **changes: Any) -> Any:
    trainer = set_up(config, **changes)
    trainer.train()
    return trainer


def newest(trainer: Any) -> dict[str, Any]:
    return load_newest(trainer.checkpoint_dir)[1]


def test_a_run_spends_its_budget_on_the_schedules_that_were_planned(config, clock):
    clock.compiling = 300.0  # is no part of the budget
    trainer = train(config)
    clock.now -= 300.0
    assert 0.9 * BUDGET <= clock.now <= BUDGET
    saved, plan = newest(trainer), newest(trainer)["budget"]
    assert saved["step"] + 1 >= plan["steps"] == trainer.config.max_num_iterations > 15
    assert saved["nominal"] == 30_000
    text = (trainer.base_dir / "config.yml").read_text()
    model = yaml.load(text, yaml.UnsafeLoader).pipeline.model
    assert model.schedule_scale == plan["steps"] / 30_000 == trainer.pipeline.model.schedule.scale
    assert model.train_downscale == 1
    assert trainer.optimizers.optimizers["means"].param_groups[0]["lr"] < 1.3 * 1.6e-6


def test_photos_are_smaller_where_too_few_steps_of_whole_ones_would_fit(config, clock):
    clock.fixed, clock.pixels = 0.05, 1.0
    trainer = train(config)
    assert newest(trainer)["budget"]["downscale"] == 2
    assert trainer.pipeline.model.config.downscale_factor(30_000, 1) == 2
    assert 0.9 * BUDGET <= clock.now <= BUDGET


def test_a_machine_that_gets_slower_brings_the_schedules_to_their_end(config, clock):
    """After trial steps, which leave a model that has learned nothing."""
    trainer = set_up(config)
    model = trainer.pipeline.model
    assert torch.equal(model.gauss_params["means"].data.cpu(), model.seed_points[0].cpu())
    assert clock.now > 2 + 4 * 0.5 and trainer._steps_done == 0
    clock.fixed *= 3
    trainer.train()
    assert 0.9 * BUDGET <= clock.now <= BUDGET + 1.7  # the last step
    saved = newest(trainer)
    assert saved["step"] + 1 < 0.8 * saved["budget"]["steps"]
    assert saved["nominal"] >= 28_000


@pytest.mark.parametrize("stopped_at", [8, 16])
def test_a_stopped_run_goes_on_and_counts_what_was_spent(config, clock, stopped_at):
    """Also after more steps than had been planned, and if photos load slowly the second time."""
    first = set_up(config)
    stop = [TrainingCallbackLocation.AFTER_TRAIN_ITERATION]
    first.callbacks.append(
        TrainingCallback(stop, lambda step: setattr(first, "stop_training", step >= stopped_at))
    )
    first.train()
    spent = newest(first)["budget"]["spent"]
    assert spent == pytest.approx(clock.now) and spent < 0.9 * BUDGET
    clock.now, clock.loading = 0.0, 2.5
    second = train(config, load_dir=first.checkpoint_dir, timestamp="on")
    assert 0.9 * BUDGET <= spent + clock.now <= BUDGET + 0.7  # the last step
    assert newest(second)["budget"]["steps"] == newest(first)["budget"]["steps"]
    assert newest(second)["nominal"] > newest(first)["nominal"]
    with pytest.raises(ConfigError, match="nothing left"):
        train(config, load_dir=second.checkpoint_dir, timestamp="more")


def test_a_budget_that_holds_no_run_is_refused_with_one_that_does(config, clock):
    with pytest.raises(ConfigError, match=r"Give (\d+)s or more") as refused:
        train(config, budget="14s")
    enough = str(refused.value).split("Give ")[1].split("s or")[0]
    clock.now = 0.0
    assert newest(train(config, budget=enough))["step"] + 1 >= 12


def test_a_budget_that_is_no_time_is_refused_before_anything_is_read(config):
    config.budget, config.data = "soon", None
    with pytest.raises(ConfigError, match="--budget"):
        config.setup(local_rank=0, world_size=1)
