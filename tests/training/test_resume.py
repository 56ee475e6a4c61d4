"""State beyond the model: generators, moments and positions come back."""

import io
import random
from typing import Any

import pytest
import torch

from desplat_ns.training.resume import restore_rng, rng_state


def draws() -> list[Any]:
    """Numbers from every generator; every other one of `gauss` is a cached one."""
    return [torch.rand(3).tolist(), random.random(), random.gauss(0, 1)]


@pytest.mark.parametrize("drawn", [0, 1])
def test_restored_generators_draw_the_same_numbers(drawn):
    for _ in range(drawn):
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
