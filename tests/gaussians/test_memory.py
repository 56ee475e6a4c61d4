"""What static Gaussians remember follows them."""

import torch
from gsplat.strategy.ops import duplicate, remove
from torch import nn

from desplat_ns.gaussians.memory import GaussianMemory

CPU = torch.device("cpu")


def test_values_follow_clones_and_prunes():
    state: dict = {}
    memory = GaussianMemory(state)
    assert torch.equal(memory.values("usual", 3, CPU), torch.zeros(3))
    memory.remember(usual=torch.tensor([1.0, 2.0, 3.0]), visits=5)
    params: dict = {"means": nn.Parameter(torch.zeros(3, 3))}
    optimizers: dict = {"means": torch.optim.Adam([params["means"]])}
    duplicate(params, optimizers, state, torch.tensor([False, True, False]))
    assert memory.values("usual", 4, CPU).tolist() == [1.0, 2.0, 3.0, 2.0]
    remove(params, optimizers, state, torch.tensor([True, False, False, False]))
    assert memory.values("usual", 3, CPU).tolist() == [2.0, 3.0, 2.0]
    assert memory.number("visits") == 5
