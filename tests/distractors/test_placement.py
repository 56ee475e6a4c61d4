"""Regions become distractors; what distractors cover is not the static scene's to fit."""

import dataclasses

import torch
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.protocol import View
from desplat_ns.distractors import distractors as module
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.distractors import Distractors
from desplat_ns.distractors.placement import (
    distractor_weight,
    lie_in,
    placement,
)
from desplat_ns.separation.grid import grid_of, region_pixels
from desplat_ns.separation.residuals import RESIDUAL_MEDIANS
from desplat_ns.step import Step
from tests.helpers.well_known_scene import HEIGHT, WIDTH, WellKnownScene, cameras, the_view

CONFIG = DistractorConfig(start="residual", initial_opacity=0.5)


def a_photo() -> torch.Tensor:
    return torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(0))


def alpha(value: float) -> torch.Tensor:
    return torch.full((HEIGHT, WIDTH, 1), value)


def block() -> torch.Tensor:
    regions = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    regions[10:20, 30:50] = True
    return regions


def placed(alpha_d: torch.Tensor, regions: torch.Tensor) -> dict[str, torch.Tensor] | None:
    none = torch.zeros(0, 3)
    changed = placement(the_view(), a_photo(), alpha_d, regions, none, CONFIG)
    return None if changed is None else changed[1]


def pixels(means: torch.Tensor, view: View) -> torch.Tensor:
    in_camera = means @ view.viewmat[:3, :3].T + view.viewmat[:3, 3]
    projected = in_camera @ view.K.T
    return projected[:, :2] / projected[:, 2:]


def test_new_distractors_lie_on_the_cells_of_the_region_in_the_photos_colours():
    regions = torch.zeros(HEIGHT // 2, WIDTH // 2, dtype=torch.bool)  # cells of 2 x 2 pixels
    regions[5:10, 15:25] = True
    new = placed(alpha(0.4), regions)
    assert new is not None
    places = pixels(new["means"], the_view())
    x, y = torch.meshgrid(torch.arange(31.0, 50, 2), torch.arange(11.0, 20, 2), indexing="xy")
    expected = torch.stack([x, y], dim=-1).reshape(-1, 2)
    assert torch.allclose(places, expected, atol=1e-3)
    patch = a_photo()[10:12, 30:32].mean((0, 1))
    assert torch.allclose(new["rgbs"][0], patch, atol=1e-6)
    assert torch.allclose(new["opacities"].sigmoid(), torch.tensor(0.5))


def test_none_is_placed_in_a_cell_that_is_covered():
    covered = alpha(0.0)
    covered[10:12] = 0.6
    new = placed(covered, block())
    assert new is not None
    assert len(new["means"]) == 8 * 20
    assert placed(alpha(0.6), block()) is None


def test_those_in_the_region_stay():
    everywhere = dataclasses.replace(CONFIG, start="everywhere", per_view=600)
    distractors = Distractors(everywhere, SplatfactoModelConfig(), cameras())
    means = distractors.views[0].params["means"].detach()
    keep = lie_in(block(), means, the_view())
    x, y = pixels(means, the_view()).unbind(-1)
    assert torch.equal(keep, (x >= 30) & (x < 50) & (y >= 10) & (y < 20))
    assert 30 < keep.sum() < 70


class Trained:
    """The layer in front of a scene that is known well, step by step."""

    def __init__(self, num_views: int = 40) -> None:
        self.scene, cams = WellKnownScene(), cameras()[torch.zeros(num_views, dtype=torch.long)]
        warmed_up = dataclasses.replace(CONFIG, static_warmup=5)
        self.layer = Distractors(warmed_up, SplatfactoModelConfig(), cams)

    def step(self, number: int, photo: torch.Tensor) -> Step:
        scene, step = self.scene, self.scene.train_step(number, photo)
        none = alpha(0.0)
        self.layer.look(step, scene.opacities, scene.state)
        self.layer.remember(step, scene.state)
        self.layer.commit(step, lambda _: none.flatten())
        return step

    @property
    def count(self) -> int:
        return len(self.layer.views[0])


def test_with_two_photos_nothing_is_placed_and_in_the_warm_up_views_are_only_remembered():
    for trained, last, remembers in ((Trained(num_views=2), 100, False), (Trained(), 4, True)):
        for number in range(5):
            trained.step(min(number, last - 1), trained.scene.photo)
        step = trained.step(last, trained.scene.with_an_occluder())
        assert step.regions is None
        assert trained.count == 0
        assert (RESIDUAL_MEDIANS in trained.scene.state) == remembers


def test_once_placing_has_stopped_none_comes_and_none_goes(monkeypatch):
    monkeypatch.setattr(module, "STOP_PLACING_AT", 20)
    trained = Trained()
    scene = trained.scene
    for number in range(5):
        trained.step(number, scene.photo)
    trained.step(20, scene.with_an_occluder())
    assert trained.count == 0
    trained.step(19, scene.with_an_occluder())
    placed = trained.count
    assert placed > 0
    trained.step(20, scene.photo)
    assert trained.count == placed
    trained.step(19, scene.photo)
    assert trained.count == 0


def test_the_weight_of_distractors_reaches_a_cell_beyond_their_edge():
    alpha_d = torch.zeros(135, 240, 1)
    alpha_d[50:60, 100:120] = 0.6
    alpha_d[90:100] = 0.4
    expected = torch.zeros(135, 240, 1)
    expected[48:62, 98:122] = 0.6
    expected[88:102] = 0.4
    assert torch.equal(distractor_weight(alpha_d), expected)


def test_a_region_has_weight_1_whatever_covers_it():
    height, width = 90, 160
    columns, rows = grid_of(width, height)
    regions = torch.zeros(rows, columns, dtype=torch.bool)
    regions[:, : columns // 2] = True
    in_region = region_pixels(regions, height, width)
    weight = distractor_weight(torch.full((height, width, 1), 0.25), in_region.float())
    assert torch.equal(weight == 1, in_region)
    assert (weight[weight != 1] == 0.25).all()
