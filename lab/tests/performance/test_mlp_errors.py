"""The network whose errors are measured tones colours, and float64 has no error against itself."""

from __future__ import annotations

import copy

import torch

from lab.performance import mlp_errors
from lab.performance.mlp_errors import colors_and_gradients, trained_network


def test_errors_are_of_a_network_that_tones(monkeypatch):
    monkeypatch.setattr(mlp_errors, "NUM", 300)
    network = trained_network()
    exact = colors_and_gradients(copy.deepcopy(network).double(), torch.float64)
    again = colors_and_gradients(copy.deepcopy(network).double(), torch.float64)
    rough = colors_and_gradients(network, torch.float32)
    assert all(torch.equal(a, b) for a, b in zip(exact, again, strict=True))
    assert 0 < (rough[0] - exact[0]).abs().max() < 1e-5
    assert 0.02 < exact[0].std() < 2 and all(t.abs().max() > 0 for t in exact)
