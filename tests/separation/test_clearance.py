"""Nothing static hangs right in front of a camera."""

import pytest
import torch

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.model import DeSplatModel
from desplat_ns.rendering.near_plane import scene_start
from desplat_ns.rendering.views import view_of, views_of
from desplat_ns.separation.clearance import EXTINGUISHED, Clearance
from tests.helpers.cameras import cameras
from tests.helpers.small_model import Trainer, make_model

EYE = torch.tensor([1.0, 2.0, 3.0])
"""Of `cameras()`, which looks along +y."""

(VIEW,) = views_of(cameras())


def wall(depth: float, n: int = 400) -> torch.Tensor:
    """Points in a plane before the camera, all in its image."""
    across = torch.rand(n, 2, generator=torch.Generator().manual_seed(0)) - 0.5
    offsets = [across[:, 0] * depth, torch.full((n,), depth), 0.5 * across[:, 1] * depth]
    return EYE + torch.stack(offsets, dim=-1)


def test_the_scene_starts_at_the_nearest_points_but_for_some_that_are_astray():
    points = torch.cat([wall(2.0), wall(5.0), wall(0.1, 3)])
    assert scene_start(points, VIEW) == pytest.approx(2.0)


def test_points_that_a_view_does_not_show_say_nothing_about_it():
    behind, aside = EYE - torch.tensor([0.0, 1.0, 0.0]), EYE + torch.tensor([9.0, 1.0, 0.0])
    assert scene_start(torch.stack([behind, aside]), VIEW) == 0.0
    assert scene_start(behind.expand(0, 3), VIEW) == 0.0
    points = torch.cat([wall(3.0), behind.expand(50, 3), aside.expand(50, 3)])
    assert scene_start(points, VIEW) == pytest.approx(3.0)


def test_what_a_view_shows_nearer_goes_out_and_nothing_else():
    ahead = torch.tensor([0.0, 1.0, 0.0])
    means = torch.stack([EYE + ahead * depth for depth in (0.5, 0.99, 1.01, 4.0)])
    beside = EYE + torch.tensor([[2.0, 0.5, 0.0]])  # it reaches into the image, its centre does not
    means, opacities = torch.cat([means, beside]), torch.ones(5, 1)
    clearance = Clearance(0.5, wall(2.0), cameras())
    visible = torch.tensor([True, False, True, True, True])
    clearance.hide_near_camera(0, view_of(cameras()), means, opacities, visible)
    assert opacities.flatten().tolist() == [EXTINGUISHED, 1.0, 1.0, 1.0, 1.0]


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [0.0, 0.5])
def test_a_gaussian_before_a_camera_is_pruned_when_clearance_says_so(clearance):
    """Cameras at z = 3 look at points around the origin; one Gaussian hangs at 0.3 before one."""
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(1)) - 0.5
    model = make_model(
        points,
        distractors=DistractorConfig(per_view=20, clearance=clearance),
        warmup_length=1,
        refine_every=4,
    )
    trainer, last = Trainer(model), len(points) - 1
    model.gauss_params["means"].data[last] = torch.tensor([0.0, 0.0, 2.7])
    model.gauss_params["opacities"].data[:] = 2.0
    for step in range(9):
        trainer.step(step, step % 3)
    hangs = model.means[:, 2] > 2.0
    assert bool(hangs.any()) == (clearance == 0)
    assert model.num_points > 100


def with_one_before_a_camera(stop: int) -> tuple[DeSplatModel, Trainer]:
    """Points around the origin and one at 0.3 before the cameras; until `stop` it may be refined,
    every fifth step."""
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(1)) - 0.5
    model = make_model(
        points,
        distractors=DistractorConfig(per_view=20, start="residual", clearance=0.5),
        warmup_length=10_000,
    )
    model.strategy.refine_every, model.strategy.refine_stop_iter = 5, stop
    model.gauss_params["means"].data[100] = torch.tensor([0.0, 0.0, 2.7])
    model.gauss_params["opacities"].data[:] = 2.0
    return model, Trainer(model)


def extinguished(model: DeSplatModel) -> int:
    return int((model.gauss_params["opacities"] < EXTINGUISHED + 1).sum())


def test_what_is_cleared_after_the_last_refinement_is_removed_with_all_that_belongs_to_it():
    model, trainer = with_one_before_a_camera(stop=2)
    for step in range(1, 5):
        trainer.step(step, step % 3)
    assert extinguished(model) == 1
    kept = model.gauss_params["opacities"].flatten() > EXTINGUISHED + 1
    before = {name: value[kept].clone() for name, value in model.gauss_params.items()}
    times = model.strategy_state["usual_residual"][kept].clone()
    model.sweep()
    assert extinguished(model) == 0
    assert model.num_points == 200 - 1
    for name, value in model.gauss_params.items():
        assert torch.equal(value, before[name])
        (group,) = trainer.optimizers[name].param_groups
        assert group["params"][0] is value
        moments = trainer.optimizers[name].state[value]
        assert moments["exp_avg"].shape == value.shape
    assert torch.equal(model.strategy_state["usual_residual"], times)
    trainer.step(5, 1)
    assert model.strategy_state["usual_residual"].shape == (199,)


@pytest.mark.slow
def test_once_refinement_is_over_it_happens_as_often_as_refinement_did():
    model, trainer = with_one_before_a_camera(stop=6)
    counts = []
    for step in range(1, 11):
        trainer.step(step, step % 3)
        counts.append(model.num_points)
    assert extinguished(model) == 0
    assert counts == [200] * 9 + [199]


def test_where_nothing_is_cleared_faint_gaussians_stay():
    """And where every one is faint, so that something is left to look at."""
    model, trainer = with_one_before_a_camera(stop=0)
    trainer.step(1)
    model.gauss_params["opacities"].data[:] = EXTINGUISHED
    model.sweep()
    assert model.num_points == 200
    assert model.layer is not None
    model.layer.clearance.depths = [0.0, 0.0, 0.0]
    model.gauss_params["opacities"].data[:100] = 0.0
    model.sweep()
    assert model.num_points == 200
    model.layer.clearance.depths = [0.0, 0.1, 0.0]
    model.sweep()
    assert model.num_points == 100
