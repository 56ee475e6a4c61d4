"""Relocation: what a set shows hardly changes when faint Gaussians join opaque ones."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from desplat_ns.gaussians.relocation import (
    MOST_SHARING,
    RelocatingStrategy,
    RelocationConfig,
    position_noise,
    shared_opacity,
    shared_scale,
)

NAMES = ("means", "scales", "quats", "opacities", "features_dc")


def covered(opacity: float, sharing: int, width: float) -> float:
    """Integral along a line of what `sharing` Gaussians of that width cover together."""
    x = np.linspace(-12, 12, 100_001)
    alpha = 1 - (1 - opacity * np.exp(-((x / width) ** 2))) ** sharing
    return float(alpha.sum() * (x[1] - x[0]))


@given(st.floats(0.01, 0.999), st.integers(1, MOST_SHARING))
def test_sharers_cover_what_one_covered(opacity, sharing):
    one, count = torch.tensor([opacity], dtype=torch.float64), torch.tensor([sharing])
    new = shared_opacity(one, count).item()
    width = shared_scale(one, count).item()
    assert 1 - (1 - new) ** sharing == pytest.approx(opacity, rel=1e-9)
    assert covered(new, sharing, width) == pytest.approx(covered(opacity, 1, 1.0), rel=1e-6)


def test_two_that_share_by_hand():
    """o = 0.75: p = 0.5, the integral is 2 p - p^2 / sqrt 2 = 1 - 0.25 / sqrt 2."""
    opacity, two = torch.tensor([0.75]), torch.tensor([2])
    assert shared_opacity(opacity, two).item() == pytest.approx(0.5)
    assert shared_scale(opacity, two).item() == pytest.approx(0.75 / (1 - 0.25 / 2**0.5))


def make_set(opacities: list[float]):
    torch.manual_seed(0)
    count = len(opacities)
    values = {
        "means": torch.randn(count, 3),
        "scales": torch.randn(count, 3) - 2,
        "quats": torch.randn(count, 4),
        "opacities": torch.logit(torch.tensor(opacities))[:, None],
        "features_dc": torch.rand(count, 3),
    }
    params = torch.nn.ParameterDict({k: torch.nn.Parameter(v) for k, v in values.items()})
    optimizers = {k: torch.optim.Adam([params[k]], lr=1e-3) for k in NAMES}
    torch.stack([p.square().sum() for p in params.values()]).sum().backward()
    for optimizer in optimizers.values():
        optimizer.step()
    return params, optimizers


def strategy(**changes) -> RelocatingStrategy:
    config = RelocationConfig(noise=0.0)
    return RelocatingStrategy(config, 10, 0, 1000, **changes)


def test_the_faint_move_onto_the_opaque_and_share_with_them():
    params, optimizers = make_set([0.9, 0.001, 0.002])
    before = {name: p.detach().clone() for name, p in params.items()}
    memory = {"seen": torch.tensor([7.0, 1.0, 2.0])}
    strategy(most=3).step_post_backward(params, optimizers, memory, 10, {})
    assert torch.equal(params["means"], before["means"][[0, 0, 0]])
    opacity = before["opacities"][0].sigmoid()
    share = shared_opacity(opacity, torch.tensor([3]))
    assert torch.allclose(params["opacities"].sigmoid(), share.expand(3, 1), rtol=1e-5)
    narrower = shared_scale(opacity, torch.tensor([3])).log()
    assert torch.allclose(params["scales"], (before["scales"][0] + narrower).expand(3, 3))
    assert torch.equal(memory["seen"], torch.tensor([7.0, 7.0, 7.0]))
    for name, optimizer in optimizers.items():
        assert optimizer.param_groups[0]["params"] == [params[name]]
        assert optimizer.state[params[name]]["exp_avg"].abs().max() == 0


def test_what_is_neither_faint_nor_chosen_stays_with_its_moments():
    params, optimizers = make_set([0.9, 0.001, 0.9999, 0.9998])
    before, moments = params["means"].clone(), optimizers["means"].state[params["means"]]
    first = moments["exp_avg"].clone()
    strategy(most=4).step_post_backward(params, optimizers, {}, 10, {})
    stayed = [row for row in (0, 2, 3) if not torch.equal(params["means"][1], before[row])]
    assert len(stayed) == 2
    assert torch.equal(params["means"][stayed], before[stayed])
    after = optimizers["means"].state[params["means"]]["exp_avg"]
    assert torch.equal(after[stayed], first[stayed]) and first[stayed].abs().min() > 0


def test_the_set_grows_up_to_its_limit_and_no_further():
    params, optimizers = make_set([0.5] * 100)
    growing = strategy(most=107)
    growing.step_post_backward(params, optimizers, {}, 10, {})
    assert len(params["means"]) == 105
    for step in (20, 30):
        growing.step_post_backward(params, optimizers, {}, step, {})
    assert {len(p) for p in params.values()} == {107}


@pytest.mark.parametrize("step", [0, 5, 1000, 1010])
def test_nothing_moves_between_the_relocations_nor_before_and_after_them(step):
    params, optimizers = make_set([0.9, 0.001])
    before = params["means"].clone()
    strategy().step_post_backward(params, optimizers, {}, step, {})
    assert torch.equal(params["means"], before)


def test_a_set_in_which_all_are_faint_is_left_alone():
    params, optimizers = make_set([0.001, 0.002])
    before = params["means"].clone()
    strategy(most=2).step_post_backward(params, optimizers, {}, 10, {})
    assert torch.equal(params["means"], before)


def test_noise_lies_in_the_plane_of_a_flat_gaussian_and_spares_the_opaque():
    count = 2000
    params = {
        "means": torch.zeros(count, 3),
        "scales": torch.tensor([[2.0, 1.0, 1e-6]]).log().expand(count, 3),
        "quats": torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(count, 4),
        "opacities": torch.full((count, 1), -20.0),
    }
    torch.manual_seed(0)
    noise = position_noise(params)
    full = 1 / (1 + np.exp(-0.5))  # opacity 0
    assert noise.std(dim=0)[:2].tolist() == pytest.approx([4 * full, full], rel=0.1)
    assert noise[:, 2].abs().max() < 1e-10
    opaque = position_noise(params | {"opacities": torch.full((count, 1), 5.0)})
    assert opaque.abs().max() < 1e-20


def test_the_price_is_that_of_mean_opacity_and_mean_scale():
    params = {"opacities": torch.zeros(4, 1), "scales": torch.full((4, 3), 3.0).log()}
    price = RelocationConfig(opacity_price=0.1, scale_price=0.01).price(params)
    assert price.item() == pytest.approx(0.1 * 0.5 + 0.01 * 3)
