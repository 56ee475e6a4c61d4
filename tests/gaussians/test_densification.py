"""Distractors are cloned, split and pruned view by view, and Adam's moments follow."""

from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.gaussians.densification import DistractorDensifier, strategy_info
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians

VIEW = View(torch.eye(4), torch.eye(3), width=20, height=10)
STATIC = SplatfactoModelConfig(warmup_length=10, densify_grad_thresh=0.5)


class Scene:
    """Two views of `per_view` distractors, their optimizers and a densifier."""

    def __init__(self, per_view: int = 4, **config: Any):
        config = {"refine_every": 2, "stop_densify_at": 1000} | config
        self.config = DistractorConfig(per_view=per_view, initial_opacity=0.5, **config)
        poses = torch.eye(4)[:3].repeat(2, 1, 1)
        self.distractors = DistractorGaussians(
            self.config, Cameras(poses, 20.0, 20.0, 10.0, 5.0, 20, 10)
        )
        self.densifier = DistractorDensifier(self.config, STATIC)
        self.pixels = torch.full((99,), 100.0)
        """What each distractor makes up of the image."""

    def params(self, view: int = 0):
        return self.distractors.views[view].params

    def visit(self, step: int, view: int = 0, grad: float | list[float] = 0.0) -> None:
        """One training step on `view`; `grad` is the screen-space gradient of its Gaussians."""
        params = self.params(view)
        n = len(params["means"])
        group = self.distractors.views[view]
        group.begin_step(dict.fromkeys(params, 1e-3))
        weighted = [(p * torch.arange(1.0, n + 1)[:, None]).sum() for p in params.values()]
        torch.stack(weighted).sum().backward()
        for optimizer in group.optimizers.values():
            optimizer.step()
        means2d: Any = torch.zeros(1, n, 2)
        means2d.absgrad = torch.zeros(1, n, 2)
        # The strategy multiplies by half the width: 10 pixels.
        means2d.absgrad[0, :, 0] = torch.as_tensor(grad) / 10
        rendering = Rendering(
            torch.zeros(10, 20, 3), torch.zeros(10, 20, 1), None, means2d, torch.ones(n).int()
        )
        info = strategy_info(rendering, VIEW)
        self.densifier.after_step(group, step, info, lambda held: self.pixels[: len(held["means"])])

    def moment(self, name: str, view: int = 0) -> torch.Tensor:
        group = self.distractors.views[view]
        return group.optimizers[name].state[group.params[name]]["exp_avg"]


def test_faint_ones_are_pruned_and_the_others_keep_their_moments():
    scene = Scene()
    scene.visit(11)
    with torch.no_grad():
        scene.params()["opacities"][1] = -5.0
    means = scene.params()["means"].detach().clone()
    scene.visit(12)
    assert scene.distractors.counts() == [3, 4]
    assert torch.allclose(scene.params()["means"], means[[0, 2, 3]], atol=3e-3)
    # Gradients are 1, 2, 3, 4 by row: the first moment tells the rows apart.
    after_two_steps = 0.1 + 0.9 * 0.1
    expected = torch.tensor([1.0, 3.0, 4.0]) * after_two_steps
    for name in scene.params():
        assert torch.allclose(scene.moment(name)[:, 0], expected, rtol=1e-5)


def test_a_steep_one_is_cloned_and_the_clone_has_no_moments_yet():
    scene = Scene()
    with torch.no_grad():
        scene.params()["scales"].fill_(-20.0)
    for step in (11, 12):
        scene.visit(step, grad=[0.0, 0.0, 1.0, 0.0])
    assert scene.distractors.counts() == [5, 4]
    means = scene.params()["means"]
    assert torch.equal(means[4], means[2])
    assert (scene.moment("means")[4] == 0).all()
    assert (scene.moment("means")[:4] != 0).all()


def test_a_steep_and_wide_one_is_split():
    scene = Scene()
    with torch.no_grad():
        scene.params()["scales"].fill_(-1.0)
    for step in (11, 12):
        scene.visit(step, grad=[0.0, 1.0, 0.0, 0.0])
    assert scene.distractors.counts() == [5, 4]
    # The two halves come last, each 1.6 times smaller.
    scales = scene.params()["scales"].exp()
    assert torch.allclose(scales[3:], scales[:1] / 1.6, rtol=1e-2)


def test_width_is_measured_against_the_depth_at_which_distractors_start():
    """Two steep ones: one wide for something so near is split, one narrow even there is cloned."""
    scene = Scene(depth=0.02)
    limit = STATIC.densify_size_thresh * 0.02
    with torch.no_grad():
        scene.params()["scales"][:2] = torch.tensor([[1.5 * limit], [limit / 1.5]]).log()
    for step in (11, 12):
        scene.visit(step, grad=[1.0, 1.0, 0.0, 0.0])
    assert scene.distractors.counts() == [6, 4]
    scales, means = scene.params()["scales"].exp(), scene.params()["means"]
    assert torch.equal(means[3], means[0])  # the clone, before the halves
    assert torch.allclose(scales[4:], torch.tensor(1.5 * limit / 1.6), rtol=1e-2)


def test_nothing_is_refined_while_the_static_scene_trains_alone():
    scene = Scene(static_warmup=20, refine_every=1)
    for step in range(11, 21):
        scene.visit(step, grad=1.0)
    assert scene.distractors.counts() == [4, 4]
    scene.visit(21, grad=1.0)
    assert scene.distractors.counts() == [8, 4]


def test_training_goes_on_after_every_change():
    scene = Scene()
    for step in range(11, 31):
        scene.visit(step, grad=1.0)
    before = scene.params()["means"].detach().clone()
    scene.visit(31)
    assert len(before) > 4
    assert (scene.params()["means"] != before).all()


def test_the_other_views_are_left_alone():
    scene = Scene()
    other = {name: p.detach().clone() for name, p in scene.params(1).items()}
    for step in range(11, 21):
        scene.visit(step, view=0, grad=1.0)
    assert all(torch.equal(scene.params(1)[name], value) for name, value in other.items())
    assert [view.refinement for view in scene.distractors.views] == [10, 0]


def test_refinement_falls_due_for_all_views_and_each_has_it_when_it_is_next_seen():
    scene = Scene(refine_when_next_seen=True)
    scene.visit(11, view=0, grad=1.0)
    scene.visit(12, view=1, grad=1.0)
    assert scene.distractors.counts() == [4, 8]
    scene.visit(13, view=0, grad=1.0)
    assert scene.distractors.counts() == [8, 8]


def test_by_splatfactos_clock_the_view_that_is_drawn_when_refinement_falls_due_has_it_alone():
    scene = Scene()
    for step in range(11, 17):
        scene.visit(step, view=1 - step % 2, grad=1.0)  # view 1 at even steps
    assert scene.distractors.counts()[0] == 4
    assert scene.distractors.counts()[1] > 4
    scene.visit(17, view=1, grad=1.0)
    scene.visit(18, view=0, grad=1.0)
    assert scene.distractors.counts()[0] == 8


@pytest.mark.parametrize(("step", "refined"), [(10, False), (11, True), (999, True), (1000, False)])
def test_refinement_keeps_to_its_time(step, refined):
    scene = Scene(refine_every=1)
    scene.visit(step, grad=1.0)
    assert (scene.distractors.counts()[0] > 4) is refined


def test_opacity_is_never_reset():
    scene = Scene(stop_densify_at=10**6)
    with torch.no_grad():
        scene.params()["opacities"].fill_(5.0)
    for step in range(3000, 3020):
        scene.visit(step)
    assert (scene.params()["opacities"] > 4.9).all()


@pytest.mark.parametrize("survivors", [1, 0])
def test_one_survivor_or_none_is_no_special_case(survivors):
    scene = Scene(refine_every=1)
    with torch.no_grad():
        scene.params()["opacities"][survivors:] = -9.0
    scene.visit(11)
    assert scene.distractors.counts() == [survivors, 4]
    if survivors:
        scene.visit(12)
        assert scene.distractors.counts() == [1, 4]


def test_running_statistics_survive_a_checkpoint():
    scene = Scene(refine_every=13)
    scene.visit(11, grad=1.0)
    scene.visit(12, grad=1.0)
    saved, scene = scene.distractors.state_dict(), Scene(refine_every=13)
    scene.distractors.load_state_dict(saved)
    scene.visit(13, grad=1.0)
    assert scene.distractors.counts() == [8, 4]


def new_rows(count: int, scene: Scene) -> dict[str, torch.Tensor]:
    return {name: torch.full((count, *p.shape[1:]), 7.0) for name, p in scene.params().items()}


def test_exchanged_distractors_start_without_moments_and_the_others_keep_theirs():
    scene = Scene()
    scene.visit(11, grad=[0.1, 0.2, 0.3, 0.4])
    means, moments = scene.params()["means"].detach().clone(), scene.moment("means").clone()
    keep = torch.tensor([0, 2, 3])
    scene.distractors.views[0].exchange(keep, new_rows(2, scene))
    assert scene.distractors.counts() == [5, 4]
    assert torch.equal(scene.params()["means"][:3], means[keep])
    assert (scene.params()["means"][3:] == 7).all()
    assert torch.equal(scene.moment("means")[:3], moments[keep])
    assert (scene.moment("means")[3:] == 0).all()
    grad2d = scene.distractors.views[0].state["grad2d"]
    assert torch.allclose(grad2d, torch.tensor([0.1, 0.3, 0.4, 0.0, 0.0]))
    scene.visit(12)  # the optimizers hold the new parameters
    assert not torch.equal(scene.params()["means"][3:], torch.full((2, 3), 7.0))


def test_a_view_can_lose_all_its_distractors_and_get_new_ones():
    scene = Scene()
    scene.visit(11)
    nobody = torch.zeros(0, dtype=torch.long)
    scene.distractors.views[0].exchange(nobody, new_rows(0, scene))
    assert scene.distractors.counts() == [0, 4]
    scene.distractors.views[0].exchange(nobody, new_rows(3, scene))
    assert scene.distractors.counts() == [3, 4]
    scene.visit(12)
    assert not (scene.params()["means"] == 7).any()


def test_what_makes_up_too_little_of_the_image_is_pruned_first():
    scene = Scene(min_pixels=2.0)
    scene.pixels[:4] = torch.tensor([3.0, 1.9, 2.0, 0.0])
    scene.visit(11, grad=[0.0, 1.0, 0.0, 0.0])
    means = scene.params()["means"].detach().clone()
    assert scene.distractors.counts() == [4, 4]  # not due
    scene.visit(12, grad=[0.0, 1.0, 0.0, 0.0])
    assert scene.distractors.counts() == [2, 4]  # the steep one was not cloned
    assert torch.allclose(scene.params()["means"], means[[0, 2]], atol=3e-3)


@pytest.mark.parametrize("cull_to_the_end", [False, True])
def test_after_densification_nothing_grows_and_pruning_goes_on_where_that_is_wanted(
    cull_to_the_end,
):
    scene = Scene(stop_densify_at=20, cull_to_the_end=cull_to_the_end, min_pixels=2.0)
    with torch.no_grad():
        scene.params()["opacities"][1] = -5.0
    scene.pixels[3] = 1.0
    for step in range(20, 24):
        scene.visit(step, grad=1.0)
    assert scene.distractors.counts() == [2 if cull_to_the_end else 4, 4]


@pytest.mark.parametrize("size", [(20, 10), (200, 100), (30, 90)])
def test_a_threshold_of_ones_own_does_not_depend_on_the_images_size(size):
    """A Gaussian whose shift by a pixel changes the summed loss by 6: the mean's share shrinks."""
    width, height = size
    summed = torch.tensor([6.0, 4.0])
    for threshold, expected in ((7.0, 2), (5.0, 3), (3.0, 4)):
        scene = Scene(per_view=2, grow_grad=threshold)
        params = scene.params()
        scene.distractors.views[0].begin_step(dict.fromkeys(params, 1e-3))
        means2d: Any = torch.zeros(1, 2, 2)
        means2d.absgrad = torch.stack([torch.zeros(2), summed / (width * height)], dim=-1)[None]
        image = torch.zeros(height, width, 3)
        rendering = Rendering(image, image[..., :1], None, means2d, torch.ones(2).int())
        info = strategy_info(rendering, View(torch.eye(4), torch.eye(3), width, height))
        for step in (11, 12):
            scene.densifier.after_step(
                scene.distractors.views[0], step, info, lambda _: torch.ones(2)
            )
        assert len(params["means"]) == expected
