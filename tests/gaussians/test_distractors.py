"""Where distractors start, and how they are held."""

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.backend.protocol import RenderSettings
from desplat_ns.errors import ConfigError
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians, even_points
from desplat_ns.gaussians.parameters_of_views import ParametersOfViews
from desplat_ns.rendering.views import view_of


def cameras(scale: float = 1.0, fx: float = 70.0, width: int = 90, height: int = 160) -> Cameras:
    generator = torch.Generator().manual_seed(3)
    rotation, _ = torch.linalg.qr(torch.randn(2, 3, 3, generator=generator))
    rotation = rotation * torch.det(rotation).sign()[:, None, None]
    positions = torch.randn(2, 3, 1, generator=generator) * scale
    return Cameras(torch.cat([rotation, positions], dim=2), fx, 1.3 * fx, 40.0, 90.0, width, height)


def pixels_of(cams: Cameras, distractors: DistractorGaussians, view: int):
    v = view_of(cams[view : view + 1])
    in_camera = distractors.params_of(view)["means"] @ v.viewmat[:3, :3].T + v.viewmat[:3, 3]
    projected = in_camera @ v.K.T
    return projected[:, :2] / projected[:, 2:], in_camera[:, 2]


@pytest.mark.parametrize("cams", [cameras(), cameras(scale=100.0), cameras(fx=900.0)])
def test_they_fill_their_own_view_beyond_the_near_plane(cams):
    config = DistractorConfig(per_view=500)
    distractors = DistractorGaussians(config, cams)
    for view in range(2):
        pixels, depths = pixels_of(cams, distractors, view)
        assert (depths > RenderSettings.near_plane).all()
        assert (pixels > -0.1).all()
        assert (pixels[:, 0] < 90.1).all() and (pixels[:, 1] < 160.1).all()
        # 500 in 10 x 10 cells: 5 in each if spread evenly; none is empty.
        cells = (pixels / torch.tensor([9.0, 16.0])).long().clamp(0, 9)
        counts = torch.bincount(cells[:, 0] * 10 + cells[:, 1], minlength=100)
        assert counts.min() >= 2 and counts.max() <= 8


def test_their_size_is_half_their_spacing_on_the_image():
    square = cameras(width=120, height=120)
    distractors = DistractorGaussians(DistractorConfig(per_view=144), square)
    # 144 in 120 x 120 pixels: 10 pixels apart, sigma 5 pixels at focal length sqrt(70 * 91).
    sigma = distractors.params_of(0)["scales"].exp() / 0.02 * (70 * 91) ** 0.5
    assert torch.allclose(sigma, torch.full_like(sigma, 5.0), rtol=1e-5)


def test_even_points_leave_no_gap():
    points = even_points(1000)
    distance = torch.cdist(torch.rand(500, 2, dtype=torch.float64), points).min(dim=1).values
    # A square lattice of 1000 points leaves gaps of up to sqrt(2) / 2 / sqrt(1000) = 0.022.
    assert distance.max() < 0.04


def test_groups_cover_every_parameter_once():
    distractors = DistractorGaussians(DistractorConfig(per_view=5), cameras())
    grouped = [p for group in distractors.param_groups().values() for p in group]
    assert {id(p) for p in grouped} == {id(p) for p in distractors.parameters()}
    assert len(grouped) == 2 * 5


def test_training_mode_is_set_without_a_visit_to_every_view(monkeypatch):
    distractors = DistractorGaussians(DistractorConfig(per_view=2), cameras())

    def visited(self, mode=True):
        raise AssertionError("a view was visited")

    monkeypatch.setattr(torch.nn.ParameterDict, "train", visited)
    assert not distractors.eval().training
    assert distractors.train().training


def test_the_total_follows_the_view_that_changed():
    distractors = DistractorGaussians(DistractorConfig(per_view=5), cameras())
    assert distractors.total == 10
    params = distractors.params_of(1)
    params["means"] = torch.nn.Parameter(params["means"].data[:2])
    distractors.recount(0)
    assert distractors.total == 10
    distractors.recount(1)
    assert distractors.total == sum(distractors.counts()) == 7


def test_drawn_views_are_remembered_as_long_as_they_have_gradients():
    distractors = DistractorGaussians(DistractorConfig(per_view=2), cameras())
    groups = [g for g in distractors.param_groups().values() if isinstance(g, ParametersOfViews)]
    distractors.draws(0)
    distractors.params_of(0)["rgbs"].sum().backward()
    distractors.draws(1)
    assert [group.drawn for group in groups] == [[0, 1]] * 5
    distractors.draws(1)
    assert distractors.drawn == [0, 1]
    distractors.params_of(0)["rgbs"].grad = None
    distractors.draws(0)
    assert [group.drawn for group in groups] == [[0]] * 5


def test_colours_that_left_the_range_come_back_to_its_border():
    distractors = DistractorGaussians(DistractorConfig(per_view=2), cameras())
    rgbs = distractors.params_of(1)["rgbs"]
    with torch.no_grad():
        rgbs.copy_(torch.tensor([[-0.5, 0.5, 1.5], [0.0, 1.0, 2.0]]))
    distractors.keep_colors_in_range(1)
    assert torch.equal(rgbs, torch.tensor([[0.0, 0.5, 1.0], [0.0, 1.0, 1.0]]))


def test_a_checkpoint_with_other_numbers_loads_into_the_same_parameters():
    source = DistractorGaussians(DistractorConfig(per_view=7), cameras())
    target = DistractorGaussians(DistractorConfig(per_view=3), cameras())
    held = target.params_of(1)["means"]
    target.load_state_dict(source.state_dict())
    assert target.params_of(1)["means"] is held
    assert torch.equal(held, source.params_of(1)["means"])
    assert target.total == source.total == 14
    assert target.counts() == [7, 7]


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"depth": 0.005}, r"distractors\.depth` is 0\.005; it has to be above 0\.01"),
        ({"depth": float("nan")}, r"distractors\.depth` is nan"),
        ({"per_view": -1}, r"per-view` is -1; it has to be 0 or more"),
        ({"max_warmup_visits": -1}, r"max-warmup-visits` is -1; it has to be 0 or more"),
        ({"min_warmup_visits": -1}, r"min-warmup-visits` is -1; it has to be 0 or more"),
        ({"shaping_steps": -1}, r"shaping-steps` is -1; it has to be 0 or more"),
        ({"initial_opacity": 1.0}, r"initial-opacity` is 1\.0; it has to be in \(0, 1\)"),
        ({"strong_excess": 0.03}, r"strong-excess` is 0\.03; it has to be weak-excess, 0\.04"),
    ],
)
def test_settings_outside_their_range_are_refused(config, message):
    with pytest.raises(ConfigError, match=message):
        DistractorGaussians(DistractorConfig(**config), cameras())


def test_no_distractors_per_view_is_allowed():
    assert DistractorGaussians(DistractorConfig(per_view=0), cameras()).counts() == [0, 0]


def test_a_long_run_does_not_warm_up_for_more_than_some_visits_of_each_view():
    config = DistractorConfig(static_warmup=6000, leave_out_at=12_000, max_warmup_visits=15)
    short, long = config.for_views(1000, 100, 500), config.for_views(40, 100, 500)
    assert (short.static_warmup, short.leave_out_at) == (6000, 12_000)
    assert (long.static_warmup, long.leave_out_at) == (600, 1200)
    assert DistractorConfig().for_views(40, 100, 500).static_warmup == 0
