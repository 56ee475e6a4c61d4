"""Distractors are cloned, split and pruned view by view, and Adam's moments follow."""

from dataclasses import replace
from typing import Any, Literal

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.core.schedule import NominalStep
from desplat_ns.distractors.config import DEPTH, DistractorConfig
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.distractors.refinement import GROW_GRAD, DistractorDensifier

VIEW = View(torch.eye(4), torch.eye(3), width=200, height=100)
STATIC = SplatfactoModelConfig(warmup_length=10, densify_grad_thresh=0.5)


class Scene:
    """Two views that four distractors each cover, their optimizers and a densifier."""

    def __init__(
        self,
        start: Literal["everywhere", "residual"] = "everywhere",
        every: int = 2,
        view: View = VIEW,
        **config: Any,
    ):
        covering = DistractorConfig(per_view=4, initial_opacity=0.5, **config)
        poses, self.view = torch.eye(4)[:3].repeat(2, 1, 1), view
        width, height = view.width, view.height
        cameras = Cameras(poses, 1.0 * width, 1.0 * width, width / 2, height / 2, width, height)
        self.distractors = Distractors(covering, STATIC, cameras)
        self.densifier = DistractorDensifier(replace(covering, start=start), STATIC, every)
        self.steep = GROW_GRAD if start == "residual" else STATIC.densify_grad_thresh
        """Gradient above which one is cloned or split."""
        self.pixels = torch.full((99,), 100.0)
        """What each distractor makes up of the image."""
        self.radii = torch.ones(99).int()
        """How far each reaches on the screen, in pixels."""

    def params(self, view: int = 0):
        return self.distractors.views[view].params

    def refined(self, grad: float | list[float]) -> list[int]:
        """Numbers of distractors by view after two steps, the second of which refines the first."""
        for step in (11, 12):
            self.visit(step, grad=grad)
        return self.distractors.counts()

    def visit(self, step: int, view: int = 0, grad: float | list[float] = 0.0) -> None:
        """One training step on `view`; `grad` is the screen-space gradient of its Gaussians, as a
        multiple of what is steep."""
        params = self.params(view)
        n = len(params["means"])
        group = self.distractors.views[view]
        group.begin_step(dict.fromkeys(params, 1e-3))
        weighted = [(p * torch.arange(1.0, n + 1)[:, None]).sum() for p in params.values()]
        torch.stack(weighted).sum().backward()
        group.optimizer.step()
        width, height = self.view.width, self.view.height
        # Of the mean over the pixels by half of the width, or of the sum over them by one pixel.
        unit = width * height if self.densifier.by_pixels else width / 2
        means2d: Any = torch.zeros(1, n, 2)
        means2d.absgrad = torch.zeros(1, n, 2)
        means2d.absgrad[0, :, 0] = torch.as_tensor(grad) * self.steep / unit
        image = torch.zeros(height, width, 3)
        rendering = Rendering(image, image[..., :1], None, means2d, self.radii[:n])
        self.densifier.after_step(
            group, NominalStep(step), rendering, lambda held: self.pixels[: len(held["means"])]
        )

    def moment(self, name: str) -> torch.Tensor:
        group = self.distractors.views[0]
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


def test_a_steep_and_wide_one_is_split():
    scene = Scene()
    with torch.no_grad():
        scene.params()["scales"].fill_(-1.0)
    assert scene.refined([0.0, 2.0, 0.0, 0.0]) == [5, 4]
    # The two halves come last, each 1.6 times smaller.
    scales = scene.params()["scales"].exp()
    assert torch.allclose(scales[3:], scales[:1] / 1.6, rtol=1e-2)


def test_by_pixels_width_is_measured_against_the_depth_at_which_distractors_start():
    """Two steep ones: one wide for something so near is split, one narrow even there is cloned."""
    scene = Scene("residual")
    limit = STATIC.densify_size_thresh * DEPTH
    with torch.no_grad():
        scene.params()["scales"][:2] = torch.tensor([[1.5 * limit], [limit / 1.5]]).log()
    assert scene.refined([2.0, 2.0, 0.0, 0.0]) == [6, 4]
    scales, means = scene.params()["scales"].exp(), scene.params()["means"]
    assert torch.equal(means[3], means[0])  # the clone, before the halves
    assert torch.allclose(scales[4:], torch.tensor(1.5 * limit / 1.6), rtol=1e-2)


@pytest.mark.parametrize(
    ("step", "left"), [(3000, 5), (3001, 3), (3999, 3), (4000, 4), (15_001, 4)]
)
def test_what_is_too_wide_on_the_screen_is_split_then_pruned_then_left(step, left):
    """As by Splatfacto: pruned after the first reset, and neither from step 4,000 on."""
    scene = Scene()
    scene.radii[0] = int(0.2 * VIEW.width)
    scene.visit(step)
    assert scene.distractors.counts() == [left, 4]


@pytest.mark.parametrize(("start", "left"), [("everywhere", 3), ("residual", 4)])
@pytest.mark.parametrize("step", [3000, 3001])
def test_what_is_too_wide_in_the_world_is_pruned_after_the_first_reset(step, start, left):
    scene = Scene(start)
    with torch.no_grad():
        scene.params()["scales"][0] = torch.tensor(1.1 * STATIC.cull_scale_thresh).log()
    scene.visit(step)
    assert scene.distractors.counts() == [4 if step == 3000 else left, 4]


def test_the_other_views_are_left_alone():
    scene = Scene()
    other = {name: p.detach().clone() for name, p in scene.params(1).items()}
    for step in range(11, 21):
        scene.visit(step, view=0, grad=2.0)
    assert all(torch.equal(scene.params(1)[name], value) for name, value in other.items())
    assert scene.distractors.counts()[0] > 4
    assert [view.refinement for view in scene.distractors.views] == [10, 0]


@pytest.mark.parametrize(
    ("warmup", "step", "refined"),
    [(0, 10, 0), (0, 11, 1), (0, 14_999, 1), (0, 15_000, 0), (20, 20, 0), (20, 21, 1)],
)
def test_refinement_keeps_to_its_time(warmup, step, refined):
    """From the later of the two warm-ups on."""
    scene = Scene(static_warmup=warmup, every=1)
    scene.visit(step, grad=2.0)
    assert (scene.distractors.counts()[0] > 4) == refined


def test_exchanged_distractors_start_without_moments_and_the_others_keep_theirs():
    scene = Scene()
    scene.visit(11, grad=[0.2, 0.4, 0.6, 0.8])
    means, moments = scene.params()["means"].detach().clone(), scene.moment("means").clone()
    keep = torch.tensor([0, 2, 3])
    new = {name: torch.full((2, *p.shape[1:]), 7.0) for name, p in scene.params().items()}
    scene.distractors.views[0].exchange(keep, new)
    assert scene.distractors.counts() == [5, 4]
    assert torch.equal(scene.params()["means"][:3], means[keep])
    assert (scene.params()["means"][3:] == 7).all()
    assert torch.equal(scene.moment("means")[:3], moments[keep])
    assert (scene.moment("means")[3:] == 0).all()
    grad2d = scene.distractors.views[0].state["grad2d"]
    assert torch.allclose(grad2d, torch.tensor([0.1, 0.3, 0.4, 0.0, 0.0]))
    scene.visit(12)  # the optimizers hold the new parameters
    assert not torch.equal(scene.params()["means"][3:], torch.full((2, 3), 7.0))


def test_what_makes_up_too_little_of_the_image_is_pruned_first():
    scene = Scene("residual")
    scene.pixels[:4] = torch.tensor([1.5, 0.9, 1.0, 0.0])
    scene.visit(11, grad=[0.0, 2.0, 0.0, 0.0])
    means = scene.params()["means"].detach().clone()
    assert scene.distractors.counts() == [4, 4]  # not due
    scene.visit(12, grad=[0.0, 2.0, 0.0, 0.0])
    assert scene.distractors.counts() == [2, 4]  # the steep one was not cloned
    assert torch.allclose(scene.params()["means"], means[[0, 2]], atol=3e-3)


@pytest.mark.parametrize(("start", "left"), [("everywhere", 3), ("residual", 2)])
def test_after_densification_nothing_grows_and_pruning_goes_on(start, left):
    """Of what is faint, and by pixels of what is small, too."""
    scene = Scene(start)
    with torch.no_grad():
        scene.params()["opacities"][1] = -5.0
    scene.pixels[3] = 0.5
    for step in range(15_000, 15_004):
        scene.visit(step, grad=2.0)
    assert scene.distractors.counts() == [left, 4]


@pytest.mark.parametrize("size", [(20, 10), (30, 90)])
def test_by_pixels_what_is_steep_does_not_depend_on_the_images_size(size):
    """Where a shift by a pixel changes the summed loss by 6 and more: the mean's share shrinks."""
    scene = Scene("residual", view=View(torch.eye(4), torch.eye(3), *size))
    with torch.no_grad():
        scene.params()["scales"].fill_(-20.0)
    assert scene.refined([0.99, 1.01, 0.0, 0.0]) == [5, 4]
    means = scene.params()["means"]
    assert torch.equal(means[4], means[1])
