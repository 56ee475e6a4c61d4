"""State beyond the model: generators, moments and positions come back."""

from __future__ import annotations

import io
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from nerfstudio.engine.optimizers import AdamOptimizerConfig, Optimizers
from nerfstudio.engine.schedulers import ExponentialDecaySchedulerConfig
from torch.nn import Parameter

from desplat_ns.training.optimizers import load_moments, set_position
from desplat_ns.training.resume import restore_rng, rng_state

FILE = Path("step-000000005.ckpt")


def draws() -> list[Any]:
    """One number from every generator; the second numpy normal is the cached one."""
    normals = [np.random.normal(), np.random.normal()]
    return [torch.rand(3).tolist(), np.random.rand(), *normals, random.random(), random.gauss(0, 1)]


@pytest.mark.parametrize("drawn", [0, 1])
def test_restored_generators_draw_the_same_numbers(drawn):
    for _ in range(drawn):
        np.random.normal()
        random.gauss(0, 1)
    file = io.BytesIO()
    torch.save(rng_state(), file)
    file.seek(0)
    state = torch.load(file, weights_only=True)
    expected = draws()
    draws()
    restore_rng(state)
    assert draws() == expected


def test_a_gpu_that_a_run_does_not_use_is_left_alone(monkeypatch):
    """To ask for its generator's state would occupy hundreds of megabytes of it."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_rng_state_all", lambda: ["occupied"])
    state = rng_state()
    assert state["cuda"] == []
    restore_rng(state)


def build(scheduler: Any = None, sizes: tuple[int, ...] = (3,), name: str = "means") -> Optimizers:
    parameters = [Parameter(torch.ones(size, 2)) for size in sizes]
    group = {"optimizer": AdamOptimizerConfig(lr=1e-2), "scheduler": scheduler}
    return Optimizers({name: group}, {name: parameters})


def run(optimizers: Optimizers, steps: int) -> None:
    for _ in range(steps):
        for optimizer in optimizers.optimizers.values():
            for group in optimizer.param_groups:
                for parameter in group["params"]:
                    parameter.grad = torch.ones_like(parameter)
            optimizer.step()
        for scheduler in optimizers.schedulers.values():
            scheduler.step()


def saved(optimizers: Optimizers) -> dict[str, Any]:
    return {name: o.state_dict() for name, o in optimizers.optimizers.items()}


@pytest.mark.parametrize(
    "scheduler", [None, ExponentialDecaySchedulerConfig(lr_final=1e-4, max_steps=10)]
)
def test_moments_and_rates_come_back_exactly(scheduler):
    first, second = build(scheduler), build(scheduler)
    run(first, 5)
    load_moments(second, saved(first), FILE)
    for each in second.schedulers.values():
        set_position(each, 5)  # pyright: ignore[reportArgumentType]
    theirs, ours = first.optimizers["means"], second.optimizers["means"]
    assert ours.param_groups[0]["lr"] == theirs.param_groups[0]["lr"]
    (a,), (b,) = theirs.state.values(), ours.state.values()
    for moment in ("exp_avg", "exp_avg_sq", "step"):
        assert torch.equal(a[moment], b[moment])
    before = second.parameters["means"][0].detach().clone()
    run(first, 3)
    run(second, 3)
    assert (second.parameters["means"][0] < before).all()  # those of the model move
    assert ours.param_groups[0]["lr"] == theirs.param_groups[0]["lr"]
