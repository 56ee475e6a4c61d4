"""Fused Adam: the same steps as the plain one, where torch has it."""

import copy

import pytest
import torch
from torch import nn

from desplat_ns.method_configs import desplat
from desplat_ns.training.optimizers import (
    SHORT_RUN_GROUPS,
    FusedAdamConfig,
    raised_rates,
)


def stepped(fused: bool) -> torch.Tensor:
    rng = torch.Generator().manual_seed(3)
    parameter = nn.Parameter(torch.randn(50, 3, generator=rng))
    optimizer = FusedAdamConfig(lr=0.05, eps=1e-15, fused=fused).setup([parameter])
    for _ in range(10):
        parameter.grad = torch.randn(50, 3, generator=rng)
        optimizer.step()
    return parameter.detach()


def test_fused_steps_are_those_of_plain_adam():
    # Ten steps of at most lr, a few roundings each of numbers of order 1.
    assert torch.allclose(stepped(True), stepped(False), rtol=0, atol=10 * 8 * 2**-23)


def test_the_method_asks_for_the_fused_one():
    for name, group in desplat.config.optimizers.items():
        optimizer = group["optimizer"].setup([nn.Parameter(torch.zeros(2, 3))])
        assert optimizer.defaults["fused"], name
        assert optimizer.defaults["eps"] == 1e-15


def test_where_torch_has_none_plain_adam_is_taken(monkeypatch):
    plain = torch.optim.Adam

    def refusing(params, fused=None, **options):
        if fused:
            raise RuntimeError("`fused=True` requires all the params to be floating point Tensors")
        return plain(params, **options)

    monkeypatch.setattr(torch.optim, "Adam", refusing)
    optimizer = FusedAdamConfig(lr=0.1).setup([nn.Parameter(torch.zeros(1))])
    assert not optimizer.defaults["fused"]


def test_options_reach_adam():
    optimizer = FusedAdamConfig(lr=0.1, eps=1e-9, weight_decay=0.5).setup(
        [nn.Parameter(torch.zeros(1))]
    )
    defaults = {name: optimizer.defaults[name] for name in ("lr", "eps", "weight_decay")}
    assert defaults == {"lr": 0.1, "eps": 1e-9, "weight_decay": 0.5}
    with pytest.raises(ValueError, match="learning rate"):
        FusedAdamConfig(lr=-1.0).setup([nn.Parameter(torch.zeros(1))])


def test_only_the_static_sets_rates_are_raised_and_the_originals_stay():
    before = copy.deepcopy(desplat.config.optimizers)
    raised = raised_rates(desplat.config.optimizers, 3.0)
    assert desplat.config.optimizers == before
    assert set(raised) == set(before) >= set(SHORT_RUN_GROUPS)
    for name, group in raised.items():
        rate = before[name]["optimizer"].lr
        factor = 3.0 if name in SHORT_RUN_GROUPS else 1.0
        assert group["optimizer"].lr == pytest.approx(factor * rate)
        assert group["scheduler"] == before[name]["scheduler"]
    assert raised_rates(before, 1.0) == before
