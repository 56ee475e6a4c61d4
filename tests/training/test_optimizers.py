"""Fused Adam: the same steps as the plain one, where torch has it; and of the drawn view alone."""

import copy
from dataclasses import dataclass, field
from typing import Any

import pytest
import torch
from torch import nn

from desplat_ns.gaussians.parameters_of_views import ParametersOfViews
from desplat_ns.method_configs import desplat
from desplat_ns.training.optimizers import (
    RAISED,
    FusedAdamConfig,
    OptimizersOfViews,
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
    found = {name: optimizer.defaults[name] for name in ("lr", "eps", "weight_decay")}
    assert found == {"lr": 0.1, "eps": 1e-9, "weight_decay": 0.5}
    with pytest.raises(ValueError, match="learning rate"):
        FusedAdamConfig(lr=-1.0).setup([nn.Parameter(torch.zeros(1))])


def test_only_the_static_sets_rates_are_raised_and_the_originals_stay():
    before = copy.deepcopy(desplat.config.optimizers)
    raised = raised_rates(desplat.config.optimizers, 3.0)
    assert desplat.config.optimizers == before
    assert set(raised) == set(before) >= set(RAISED)
    for name, group in raised.items():
        rate = before[name]["optimizer"].lr
        factor = 3.0 if name in RAISED else 1.0
        assert group["optimizer"].lr == pytest.approx(factor * rate)
        assert group["scheduler"] == before[name]["scheduler"]
    assert raised_rates(before, 1.0) == before


class Watched(torch.optim.Adam):
    """Notes how many parameters there are to look at, each time that it looks."""

    looked_at: list[int]

    def zero_grad(self, set_to_none: bool = True) -> None:
        self.looked_at.append(len(self.param_groups[0]["params"]))
        super().zero_grad(set_to_none)

    def step(self, closure: Any = None) -> Any:
        self.looked_at.append(len(self.param_groups[0]["params"]))
        return super().step(closure)


@dataclass
class WatchedConfig:
    """As nerfstudio's configurations of optimizers."""

    lr: float = 0.1
    max_norm: None = None
    looked_at: list[int] = field(default_factory=list)

    def setup(self, params: list[nn.Parameter]) -> Watched:
        optimizer = Watched(params, lr=self.lr)
        optimizer.looked_at = self.looked_at
        return optimizer


def of_views(num_views: int) -> tuple[OptimizersOfViews, ParametersOfViews, WatchedConfig]:
    config = WatchedConfig()
    views = ParametersOfViews((nn.Parameter(torch.ones(3)) for _ in range(num_views)), [])
    options = {"views": {"optimizer": config, "scheduler": None}}
    return OptimizersOfViews(options, {"views": views}), views, config


def take_step(optimizers: OptimizersOfViews) -> None:
    scaler = torch.cuda.amp.GradScaler(enabled=False)
    optimizers.optimizer_scaler_step_some(scaler, ["views"])


@pytest.mark.parametrize("zero", ["all", "some"])
def test_a_step_looks_at_the_drawn_view_alone(zero):
    optimizers, views, config = of_views(50)
    for view in (7, 3):
        if zero == "all":
            optimizers.zero_grad_all()
        else:
            optimizers.zero_grad_some(["views"])
        views.drawn[:] = [view]
        views[view].square().sum().backward()
        take_step(optimizers)
    assert config.looked_at == [0, 1, 1, 1]
    assert [v for v in range(50) if not torch.equal(views[v], torch.ones(3))] == [3, 7]
    assert views[7].grad is None and views[3].grad is not None
    held = optimizers.optimizers["views"].param_groups[0]["params"]
    assert all(a is b for a, b in zip(held, views, strict=True))  # for checkpoints and refinement


def test_gradients_of_several_views_are_all_taken():
    optimizers, views, _ = of_views(5)
    views.drawn[:] = [4, 1]
    (views[1].sum() + views[4].sum()).backward()
    take_step(optimizers)
    assert [v for v in range(5) if not torch.equal(views[v], torch.ones(3))] == [1, 4]


def test_all_views_come_back_after_an_error():
    optimizers, views, _ = of_views(5)
    with pytest.raises(KeyError), optimizers.drawn_alone():
        raise KeyError
    assert len(optimizers.optimizers["views"].param_groups[0]["params"]) == len(views)
