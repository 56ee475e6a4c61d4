"""The static set refines on a whole sample, within a limit, and resets keep their place."""

from typing import Any

import pytest
import torch
from gsplat.strategy import DefaultStrategy
from gsplat.strategy.ops import normalized_quat_to_rotmat
from torch import nn

from desplat_ns.backend.protocol import Rendering
from desplat_ns.core.schedule import NominalStep
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.gaussians.strategy import UNLIMITED, StaticStrategy, long_axis_split, sample


class Scene:
    """Four Gaussians, wide enough to be split, and a strategy that refines every third step."""

    def __init__(self, **settings: Any):
        defaults: dict[str, Any] = {
            "refine_every": 3,
            "refine_start_iter": 0,
            "refine_stop_iter": 100,
            "reset_every": UNLIMITED,
            "grow_grad2d": 0.5,
            "prune_scale3d": 100.0,
            "absgrad": True,
        }
        self.strategy = StaticStrategy(**defaults | settings)
        sizes = {"means": 3, "scales": 3, "quats": 4, "opacities": 1}
        params = {k: nn.Parameter(torch.ones(4, n)) for k, n in sizes.items()}
        self.params = nn.ParameterDict(params)
        self.optimizers: Any = {k: torch.optim.Adam([p]) for k, p in self.params.items()}
        self.state = self.strategy.initialize_state()

    def step(self, step: int, grad: list[float] | float = 0.0) -> int:
        """One training step; returns how many Gaussians there are after it."""
        n = len(self.params["means"])
        means2d: Any = torch.zeros(1, n, 2)
        means2d.absgrad = torch.zeros(1, n, 2)
        means2d.absgrad[0, :, 0] = torch.as_tensor(grad) / 10  # times half the width
        black = torch.zeros(10, 20, 3)
        rendering = Rendering(black, black[..., :1], None, means2d, torch.ones(n).int())
        held = self.params, self.optimizers, self.state
        self.strategy.after_step(*held, NominalStep(step), rendering)
        return len(self.params["means"])


def test_it_refines_by_the_mean_of_a_whole_sample():
    scene = Scene()
    counts = [scene.step(step, [0.9, 0.0, 0.0, 0.0]) for step in range(1, 3)]
    assert counts == [4, 4]
    assert scene.step(3, [0.0, 0.0, 0.0, 3.0]) == 6  # means 0.6, 0, 0 and 1
    assert [scene.step(step) for step in range(4, 8)] == [6, 6, 6, 6]  # the sum started anew


@pytest.mark.parametrize("absgrad", [True, False])
@pytest.mark.parametrize("by_width", [0, 100])
def test_a_visit_is_sampled_as_gsplat_does(absgrad, by_width):
    """Of what is not visible nothing counts, not even a gradient that is no number. A length has
    three roundings and a sum of three lengths two, in either; all are positive."""
    generator, n = torch.Generator().manual_seed(0), 100
    settings: dict[str, Any] = {"absgrad": absgrad, "refine_scale2d_stop_iter": by_width}
    strategy = DefaultStrategy(**settings)
    ours, theirs = strategy.initialize_state(), strategy.initialize_state()
    params = nn.ParameterDict({"means": nn.Parameter(torch.zeros(n, 3))})
    for _ in range(3):
        radii = torch.randint(-20, 40, (n,), generator=generator).clamp(min=0).int()
        means2d: Any = torch.zeros(1, n, 2)
        gradients = torch.randn(1, n, 2, generator=generator)
        means2d.absgrad, means2d.grad = gradients.abs(), gradients
        means2d.grad[0, radii == 0] = torch.nan
        black = torch.zeros(10, 20, 3)
        sample(strategy, ours, Rendering(black, black[..., :1], None, means2d, radii))
        info = {"means2d": means2d, "radii": radii[None], "width": 20, "height": 10}
        info |= {"n_cameras": 1, "gaussian_ids": None}
        strategy._update_state(params, theirs, info)  # pyright: ignore[reportArgumentType]
    assert ours.keys() == theirs.keys()
    for name in ("grad2d", "count", *(["radii"] if by_width else [])):
        torch.testing.assert_close(ours[name], theirs[name], rtol=2 * 5 * 2**-24, atol=0)
    assert torch.equal(ours["count"], theirs["count"])
    assert ours["count"].max() > 1


def test_steps_after_a_reset_are_not_in_the_sample():
    scene = Scene(reset_every=10, pause_refine_after_reset=4)
    for step in (8, 9):
        scene.step(step)
    for step in (10, 11, 12, 13):  # recovering
        assert scene.step(step, 100.0) == 4
    assert scene.step(14, [1.0, 0.0, 0.0, 1.6]) == 5  # a third of it is 0.33 and 0.53


@pytest.mark.parametrize("every", [3, 7, 50])
def test_resets_keep_their_place_whatever_the_interval(every):
    scene = Scene(reset_every=10, pause_refine_after_reset=4, refine_every=every, prune_opa=0.1)
    reset = []
    for step in range(1, 35):
        with torch.no_grad():
            scene.params["opacities"].fill_(3.0)
        scene.step(step)
        if torch.sigmoid(scene.params["opacities"]).max() < 0.21:
            reset.append(step)
    assert reset == [10, 20, 30]


def test_with_little_room_the_steepest_grow():
    scene = Scene(most=6)
    means = torch.arange(12.0).reshape(4, 3)
    scene.params["means"].data.copy_(means)
    scene.params["scales"].data.fill_(-30.0)  # small ones are cloned: clones keep their place
    for step in (1, 2, 3):
        count = scene.step(step, [0.6, 0.9, 0.7, 0.0])
    assert count == 6
    clones = scene.params["means"][4:]
    assert torch.equal(clones, means[[1, 2]])


def test_the_long_axis_split_clones_none():
    scene = Scene(long_axis_split=True)
    scene.params["scales"].data.fill_(-5.0)  # small enough to be cloned otherwise
    for step in (1, 2, 3):
        count = scene.step(step, [0.6, 0.9, 0.0, 0.0])
    assert count == 6
    assert (scene.params["scales"].amin(dim=-1) < -5).tolist() == 2 * [False] + 4 * [True]


@pytest.mark.parametrize("most", [5, 7])
def test_wide_ones_are_split_only_where_there_is_room_and_after_the_steep(most):
    scene = Scene(most=most, refine_scale2d_stop_iter=100, grow_scale2d=0.01)
    widths = torch.tensor([8.0, 7.0, 6.0, 5.5])
    scene.params["scales"].data.copy_(widths.log()[:, None].expand(4, 3))
    for step in (1, 2, 3):  # a radius of a pixel is 0.05 of the image: all are wide
        count = scene.step(step, [0.9, 0.0, 0.1, 0.2])
    assert count == most
    left = scene.params["scales"].exp()[:, 0]
    whole = [bool(torch.isclose(left, width).any()) for width in widths]
    order = [0, 3, 2, 1]  # by gradient
    assert [whole[i] for i in order] == [k >= most - 4 for k in range(4)]


@pytest.mark.parametrize("most", [4, 7, 9, 12])
def test_a_set_stays_within_the_limit_where_gaussians_are_cloned_and_split_at_once(most: int):
    scene = Scene(most=most, refine_scale2d_stop_iter=100, grow_scale2d=0.01)
    scene.params["scales"].data.fill_(-30.0)  # small, and a radius of a pixel is wide: both
    for step in (1, 2, 3):
        count = scene.step(step, [0.9, 0.6, 0.7, 0.0])  # the last one is only split
    assert count == max(full for full in (4, 6, 8, 10, 11) if full <= most)


def test_two_halves_have_the_mass_the_mean_and_the_covariance_of_the_whole():
    """In float64, some 100 roundings of numbers of the order of 1."""
    generator = torch.Generator().manual_seed(0)
    sizes = {"means": (3,), "scales": (3,), "quats": (4,), "opacities": (1,), "features_dc": (3,)}
    params = nn.ParameterDict()
    for name, shape in sizes.items():
        drawn = torch.randn(5, *shape, generator=generator, dtype=torch.float64)
        params[name] = nn.Parameter(drawn)
    optimizers: Any = {name: torch.optim.Adam([p]) for name, p in params.items()}
    sum((p.sum() for p in params.values()), torch.tensor(0.0)).backward()
    for optimizer in optimizers.values():
        optimizer.step()
    whole = {name: p.detach().clone() for name, p in params.items()}
    state: dict[str, Any] = {"count": torch.arange(5.0)}
    long_axis_split(params, optimizers, state, torch.tensor([True, False, True, False, False]))
    assert state["count"].tolist() == [1, 3, 4, 0, 2, 0, 2]
    for parent, halves in ((0, [3, 5]), (2, [4, 6])):
        ours, wanted = moments_of(params, halves), moments_of(whole, [parent])
        torch.testing.assert_close(ours, wanted, rtol=1e-13, atol=1e-13)
        widths, before = params["scales"][halves], whole["scales"][parent]
        assert (widths.isclose(before).sum(dim=-1) == 2).all()  # the longest alone is shorter
        for name, p in params.items():
            moment = optimizers[name].state[p]["exp_avg"]
            assert not moment[halves].any() and moment[:3].all()


def moments_of(params: Any, rows: list[int]) -> tuple[torch.Tensor, ...]:
    """Mass, mean and covariance of a mixture."""
    splats = activate_static({name: p[rows] for name, p in params.items()}, None)
    masses = splats.opacities * splats.scales.prod(dim=-1)
    axes = normalized_quat_to_rotmat(nn.functional.normalize(splats.quats, dim=-1))
    weights = masses / masses.sum()
    mean = weights @ splats.means
    away = splats.means - mean
    spread = axes * splats.scales.square()[:, None] @ axes.mT + away[:, :, None] * away[:, None]
    return masses.sum(), mean, (weights[:, None, None] * spread).sum(dim=0)


@pytest.mark.parametrize(("to_the_end", "left"), [(False, 4), (True, 3)])
def test_faint_ones_go_after_densification_where_that_is_wanted(to_the_end, left):
    scene = Scene(refine_stop_iter=10, cull_to_the_end=to_the_end)
    with torch.no_grad():
        scene.params["opacities"][2] = -9.0
    assert [scene.step(step, 5.0) for step in (10, 40)] == [4, 4]
    assert scene.step(70, 5.0) == left  # the third step, as the interval says; nothing grows
