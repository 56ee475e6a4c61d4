"""State of the random generators; that it comes back is in test_trainer_checkpoints.py."""

import torch

from desplat_ns.training.resume import restore_rng, rng_state


def test_a_gpu_that_a_run_does_not_use_is_left_alone(monkeypatch):
    """To ask for its generator's state would occupy hundreds of megabytes of it."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_rng_state_all", lambda: ["occupied"])
    state = rng_state()
    assert state["cuda"] == []
    restore_rng(state)
