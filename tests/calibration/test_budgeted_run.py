"""`ns-train desplat --budget`: the clock decides, and nothing trained is lost."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import pytest
import torch
import yaml

from desplat_ns import run_config
from desplat_ns.calibration import budgeted_run, run_plan
from desplat_ns.calibration.run_plan import StepCost
from desplat_ns.datamanager import DeSplatDataManager
from desplat_ns.errors import ConfigError
from desplat_ns.model import DeSplatModel
from desplat_ns.training.budget import END_SECONDS, StepSeconds
from desplat_ns.training.checkpoint_files import load_newest

BUDGET = 40
STEPS_BETWEEN_CHECKS = 25
"""A quarter of what they are, as the runs are."""


@pytest.fixture
def clock(monkeypatch) -> SimpleNamespace:
    """A clock that goes on by a fixed time whenever it is read, which is twice in a step; steps
    were measured as it says: runs of some 90 steps, where 45 are planned."""
    clock = SimpleNamespace(now=0.0, tick=0.2, measured=0.8)

    def monotonic() -> float:
        clock.now += clock.tick
        return clock.now

    monkeypatch.setattr(budgeted_run, "time", SimpleNamespace(monotonic=monotonic))

    def measure_costs(*_: Any) -> StepCost:
        return StepCost(StepSeconds(fixed=clock.measured, whole_photo=0.0), share_at_start=1.0)

    monkeypatch.setattr(budgeted_run, "measure_costs", measure_costs)
    monkeypatch.setattr(budgeted_run, "STEPS_BETWEEN_CHECKS", STEPS_BETWEEN_CHECKS)
    monkeypatch.setattr(run_config, "compile_kernels", lambda *_: 0.0)  # by another clock
    monkeypatch.setattr(run_plan, "FEWEST_STEPS", 20)  # photos are tiny, and so are these runs
    return clock


@pytest.fixture
def config(tiny_run, tmp_path) -> Any:
    config = tiny_run(tmp_path)
    config.budget, config.max_num_iterations = f"{BUDGET}s", 30_000
    return config


def train(config: Any) -> Any:
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    trainer.train()
    return trainer


def newest(trainer: Any) -> dict[str, Any]:
    return load_newest(trainer.checkpoint_dir)[1]


def test_a_run_spends_its_budget_and_says_so(config, clock, capsys):
    trainer = train(config)
    assert 0.9 * BUDGET <= clock.now <= BUDGET
    saved = newest(trainer)
    assert saved["step"] + 1 == saved["budget"]["steps_done"] == config.max_num_iterations
    said = " ".join(capsys.readouterr().out.split())
    assert f"of {BUDGET} s were spent" in said
    assert f"{saved['budget']['state']['steps']} had been planned" in said


def test_what_a_checkpoint_will_hold_is_not_counted_in_every_step(config, clock, monkeypatch):
    counted = []
    count = DeSplatModel.trained_bytes
    monkeypatch.setattr(
        DeSplatModel, "trained_bytes", lambda self: counted.append(self.step) or count(self)
    )
    steps = newest(train(config))["budget"]["steps_done"]
    assert 2 <= len(counted) <= 2 + steps // STEPS_BETWEEN_CHECKS


def test_what_kernels_take_to_compile_is_no_part_of_the_budget(config, clock, monkeypatch):
    def compile_kernels(backend: str, device: str) -> float:
        assert (backend, device) == ("auto", config.machine.device_type)
        clock.now += 300
        return 300.0

    monkeypatch.setattr(run_config, "compile_kernels", compile_kernels)
    train(config)
    assert 0.9 * BUDGET <= clock.now - 300 <= BUDGET


def load_slowly(monkeypatch, clock: SimpleNamespace, seconds: float) -> None:
    """Let the training photos take so long: nerfstudio reads them within the first step."""
    load = DeSplatDataManager._load_images

    def slow(self: Any, split: Any, *args: Any, **kwargs: Any) -> Any:
        clock.now += seconds if split == "train" else 0.0
        return load(self, split, *args, **kwargs)

    monkeypatch.setattr(DeSplatDataManager, "_load_images", slow)


def test_photos_that_load_slowly_do_not_end_the_run_early(config, clock, monkeypatch):
    fast = newest(train(dataclasses.replace(config, timestamp="fast")))["budget"]["steps_done"]
    load_slowly(monkeypatch, clock, 0.4 * BUDGET)
    clock.now = 0.0
    steps = newest(train(dataclasses.replace(config, timestamp="slow")))["budget"]["steps_done"]
    assert 0.9 * BUDGET <= clock.now <= BUDGET
    left = (0.6 * BUDGET - END_SECONDS) / (BUDGET - END_SECONDS)
    assert steps == pytest.approx(left * fast, rel=0.1)


def test_a_run_that_goes_on_is_not_ended_early_by_photos_that_load_slowly(
    config, clock, monkeypatch
):
    load_slowly(monkeypatch, clock, 0.3 * BUDGET)
    first = config.setup(local_rank=0, world_size=1)
    first.setup()
    after_step = first._budgeted.after_step
    monkeypatch.setattr(first._budgeted, "after_step", lambda s: after_step(s) or s == 5)
    first.train()
    spent = newest(first)["budget"]["state"]["spent"]
    clock.now = 0.0
    train(dataclasses.replace(config, load_dir=first.checkpoint_dir, timestamp="on"))
    assert 0.9 * BUDGET <= spent + clock.now <= BUDGET


def test_schedules_are_those_of_the_planned_length(config, clock):
    trainer = train(config)
    scale = trainer.pipeline.model.config.schedule_scale
    first = newest(trainer)["budget"]["state"]["steps"]
    assert scale == pytest.approx(first / config.nominal_num_iterations)
    text = (trainer.base_dir / "config.yml").read_text()
    assert yaml.load(text, yaml.Loader).pipeline.model.schedule_scale == scale


def test_the_rates_reach_their_end_on_a_machine_half_as_fast_as_measured(config, clock):
    clock.tick = clock.measured = 0.2  # read twice a step
    trainer = train(config)
    group = trainer.optimizers.optimizers["means"].param_groups[0]
    state, done = newest(trainer)["budget"]["state"], newest(trainer)["budget"]["steps_done"]
    assert done < 0.6 * state["steps"]
    assert state["reached"] == pytest.approx(state["steps"], abs=2)  # a step moves two
    last_moves = 100 ** (4 / state["steps"])  # two planned steps a step: one ahead, one unread
    assert 1.6e-6 <= group["lr"] <= 1.6e-6 * last_moves  # from 1.6e-4


@pytest.mark.parametrize("stopped_at", [10, 55])
def test_a_stopped_run_goes_on_and_counts_what_was_spent(config, clock, monkeypatch, stopped_at):
    """Also after more steps than had been planned: this machine is faster than measured."""
    whole = train(dataclasses.replace(config, timestamp="whole"))
    steps = newest(whole)["budget"]["steps_done"]
    clock.now = 0.0
    first = config.setup(local_rank=0, world_size=1)
    first.setup()
    after_step = first._budgeted.after_step
    monkeypatch.setattr(first._budgeted, "after_step", lambda s: after_step(s) or s == stopped_at)
    first.train()
    spent = newest(first)["budget"]["state"]["spent"]
    assert 0 < spent < 0.9 * BUDGET
    planned = newest(first)["budget"]["state"]["steps"]
    assert 10 < planned < 55
    clock.now = 0.0
    second = train(dataclasses.replace(config, load_dir=first.checkpoint_dir, timestamp="on"))
    saved = newest(second)["budget"]
    assert spent + clock.now == pytest.approx(BUDGET, rel=0.1)
    assert saved["steps_done"] == pytest.approx(steps, rel=0.1)


def test_a_run_at_its_end_is_not_gone_on_with(config, clock):
    first = train(config)
    before = newest(first)
    with pytest.raises(ConfigError, match="nothing left to train"):
        train(dataclasses.replace(config, load_dir=first.checkpoint_dir, timestamp="on"))
    assert torch.equal(
        before["pipeline"]["_model.gauss_params.means"],
        newest(first)["pipeline"]["_model.gauss_params.means"],
    )


def test_going_on_without_the_budget_is_said(config, clock, capsys):
    first = train(config)
    steps = newest(first)["step"] + 1
    again = dataclasses.replace(config, budget="", load_dir=first.checkpoint_dir, timestamp="on")
    again.max_num_iterations = steps + 2
    train(again)
    assert "This run had a budget." in " ".join(capsys.readouterr().out.split())


def test_a_run_that_had_no_budget_is_not_gone_on_with_one(config, clock):
    plain = dataclasses.replace(config, budget="", max_num_iterations=4)
    first = train(plain)
    on = dataclasses.replace(config, load_dir=first.checkpoint_dir, timestamp="on")
    with pytest.raises(ConfigError, match="had none"):
        train(on)


def test_the_viewer_stays_open_when_the_time_is_up_and_not_when_the_run_is_stopped(
    config, clock, monkeypatch
):
    def waits_in_viewer(stopped_at: int | None) -> bool:
        clock.now = 0.0
        trainer = dataclasses.replace(config, timestamp=f"{stopped_at}").setup(
            local_rank=0, world_size=1
        )
        trainer.setup()
        at_step = trainer.pipeline.get_train_loss_dict

        def stops(step: int):
            if step == stopped_at:
                trainer.stop_training = True
            return at_step(step)

        monkeypatch.setattr(trainer.pipeline, "get_train_loss_dict", stops)
        trainer.train()
        return trainer._waiting_in_viewer

    assert waits_in_viewer(None)
    assert not waits_in_viewer(10)


def test_a_budget_that_is_no_time_is_refused_before_anything_is_read(config):
    config.budget, config.data = "soon", None
    with pytest.raises(ConfigError, match="such as 10min"):
        config.setup(local_rank=0, world_size=1)
