"""Where distractors start, and how they are held."""

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.cameras.views import view_of
from desplat_ns.core.schedule import NominalStep, RunStep
from desplat_ns.distractors.config import DistractorConfig, rates_at
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.step import Step
from tests.helpers.stub_run import assert_same

STATIC = SplatfactoModelConfig()


def cameras(scale: float = 1.0, fx: float = 70.0, width: int = 90, height: int = 160) -> Cameras:
    generator = torch.Generator().manual_seed(3)
    rotation, _ = torch.linalg.qr(torch.randn(2, 3, 3, generator=generator))
    rotation = rotation * torch.det(rotation).sign()[:, None, None]
    positions = torch.randn(2, 3, 1, generator=generator) * scale
    return Cameras(torch.cat([rotation, positions], dim=2), fx, 1.3 * fx, 40.0, 90.0, width, height)


@pytest.mark.parametrize("cams", [cameras(scale=100.0), cameras(fx=900.0)])
def test_they_fill_their_own_view_beyond_the_near_plane(cams):
    config = DistractorConfig(per_view=500)
    distractors = Distractors(config, STATIC, cams)
    for index, held in enumerate(distractors.views):
        view = view_of(cams[index : index + 1])
        in_camera = held.params["means"] @ view.viewmat[:3, :3].T + view.viewmat[:3, 3]
        assert (in_camera[:, 2] > NEAR_PLANE).all()
        projected = in_camera @ view.K.T
        pixels = projected[:, :2] / projected[:, 2:]
        assert (pixels > -0.1).all()
        assert (pixels[:, 0] < 90.1).all() and (pixels[:, 1] < 160.1).all()
        # 500 in 10 x 10 cells: 5 in each if spread evenly; none is empty.
        cells = (pixels / torch.tensor([9.0, 16.0])).long().clamp(0, 9)
        counts = torch.bincount(cells[:, 0] * 10 + cells[:, 1], minlength=100)
        assert counts.min() >= 2 and counts.max() <= 8


def test_their_size_is_half_their_spacing_on_the_image():
    square = cameras(width=120, height=120)
    distractors = Distractors(DistractorConfig(per_view=144), STATIC, square)
    # 144 in 120 x 120 pixels: 10 pixels apart, sigma 5 pixels at focal length sqrt(70 * 91).
    sigma = distractors.views[0].params["scales"].exp() / 0.02 * (70 * 91) ** 0.5
    assert torch.allclose(sigma, torch.full_like(sigma, 5.0), rtol=1e-5)


def test_nerfstudio_walks_over_no_view_and_moves_them_in_place():
    """Over modules, whose training mode it sets, and parameters of its optimizers, in every
    step."""
    distractors = Distractors(DistractorConfig(per_view=2), STATIC, cameras())
    assert list(distractors.modules()) == [distractors]
    assert list(distractors.parameters()) == []
    held = distractors.views[1].params["means"]
    torch.nn.Sequential(distractors).double()
    assert held.dtype == torch.float64
    assert distractors.views[1].params["means"] is held


def test_a_step_begins_without_gradients_and_with_the_rates_of_the_step():
    view = Distractors(DistractorConfig(per_view=2), STATIC, cameras()).views[0]
    for step in (0, 15_000):
        view.params["means"].sum().backward()
        view.begin_step(rates_at(step))
        assert view.params["means"].grad is None
        rates = {name: each.param_groups[0]["lr"] for name, each in view.optimizers.items()}
        assert rates == rates_at(step)


def test_colours_that_left_the_range_come_back_to_its_border():
    distractors = Distractors(DistractorConfig(per_view=2), STATIC, cameras())
    rgbs = distractors.views[1].params["rgbs"]
    with torch.no_grad():
        rgbs.copy_(torch.tensor([[-0.5, 0.5, 1.5], [0.0, 1.0, 2.0]]))
    view, image = View(torch.eye(4), torch.eye(3), 4, 4), torch.zeros(4, 4, 3)
    drawn = Rendering(image, image[..., :1], None, torch.zeros(1, 2, 2), torch.ones(2).int())
    step = Step(NominalStep(0), RunStep(0), 1, view, drawn, drawn)
    distractors.commit(step, lambda params: torch.ones(2))
    assert torch.equal(rgbs, torch.tensor([[0.0, 0.5, 1.0], [0.0, 1.0, 1.0]]))


def stepped(distractors: Distractors, view: int) -> None:
    """One step of Adam on a view, by gradients of 1."""
    gaussians = distractors.views[view]
    gaussians.begin_step(rates_at(0))
    torch.stack([p.sum() for p in gaussians.params.values()]).sum().backward()
    gaussians.optimizer.step()


def test_a_checkpoint_brings_moments_back_also_through_a_second_one():
    source = Distractors(DistractorConfig(per_view=4), STATIC, cameras())
    stepped(source, 0)
    source.views[0].refinement = 3
    target = source
    for _ in range(2):
        saved, target = target.state_dict(), Distractors(DistractorConfig(), STATIC, cameras())
        target.load_state_dict(saved)
    assert target.views[0].refinement == 3
    for either in (source, target):
        stepped(either, 0)
        stepped(either, 1)
    assert_same(dict(source.state_dict()), dict(target.state_dict()))
