"""Regions become distractors; what distractors cover is not the static scene's to fit."""

import dataclasses

import pytest
import torch
from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.ownership import interior, owned_share, pixels_of
from desplat_ns.separation.visit import Sighting
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.distractors import DistractorConfig, DistractorGaussians
from desplat_ns.rendering.views import view_of
from desplat_ns.separation.placement import (
    Placement,
    distractors_in,
    find_regions,
    lie_in,
    peak_excess,
    uncovered_regions,
)

WIDTH, HEIGHT = 60, 40
CONFIG = DistractorConfig(per_view=600, start="residual", initial_opacity=0.5, depth=0.5)
"""Cells of 2 x 2 pixels."""
WARMED_UP = dataclasses.replace(CONFIG, static_warmup=5, leave_out_at=10)


def cameras() -> Cameras:
    turn = torch.tensor([[0.0, 0, 1, 2], [0, 1, 0, -1], [-1, 0, 0, 3]])  # not the identity
    return Cameras(turn[None], 50.0, 55.0, 29.0, 21.0, WIDTH, HEIGHT)


def the_view() -> View:
    return view_of(cameras())


def sighting(inside: torch.Tensor, alpha: float = 0.0) -> Sighting:
    photo = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(0))
    return Sighting(0, the_view(), photo, torch.full((HEIGHT, WIDTH, 1), alpha), inside)


def block() -> torch.Tensor:
    regions = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    regions[10:20, 30:50] = True
    return regions


def pixels(means: torch.Tensor, view: View) -> torch.Tensor:
    in_camera = means @ view.viewmat[:3, :3].T + view.viewmat[:3, 3]
    projected = in_camera @ view.K.T
    return projected[:, :2] / projected[:, 2:]


def test_new_distractors_lie_on_the_cells_of_the_region_in_the_photos_colours():
    seen = sighting(block())
    new = distractors_in(uncovered_regions(seen, CONFIG), seen, CONFIG)
    found = pixels(new["means"], seen.view)
    assert len(found) == 5 * 10
    x, y = torch.meshgrid(torch.arange(31.0, 50, 2), torch.arange(11.0, 20, 2), indexing="xy")
    expected = torch.stack([x, y], dim=-1).reshape(-1, 2)
    assert torch.allclose(found, expected, atol=1e-3)
    patch = seen.photo[10:12, 30:32].mean((0, 1))
    assert torch.allclose(new["rgbs"][0], patch, atol=1e-6)
    assert torch.allclose(new["opacities"].sigmoid(), torch.tensor(0.5))


def test_as_many_pixels_wide_as_those_that_cover_the_whole_view():
    whole = DistractorGaussians(dataclasses.replace(CONFIG, start="everywhere"), cameras())
    seen = sighting(block())
    new = distractors_in(uncovered_regions(seen, CONFIG), seen, CONFIG)
    assert torch.allclose(new["scales"], whole.params_of(0)["scales"][:50], atol=1e-6)


def test_none_is_placed_where_distractors_cover_already():
    assert not uncovered_regions(sighting(block(), alpha=0.6), CONFIG).any()
    assert uncovered_regions(sighting(block(), alpha=0.4), CONFIG).sum() == 50


def test_those_in_the_region_stay():
    everywhere = dataclasses.replace(CONFIG, start="everywhere")
    distractors = DistractorGaussians(everywhere, cameras())
    means = distractors.params_of(0)["means"].detach()
    keep = lie_in(block(), means, the_view())
    x, y = pixels(means, the_view()).unbind(-1)
    assert torch.equal(keep, (x >= 30) & (x < 50) & (y >= 10) & (y < 20))
    assert 30 < keep.sum() < 70


def test_beyond_the_border_the_nearest_cell_counts():
    view = the_view()
    regions = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    regions[:, -1] = True
    camera_to_world = torch.linalg.inv(view.viewmat)
    at = torch.tensor([[0.9, 0.0, 1.0, 1.0], [-0.9, 0.0, 1.0, 1.0]]) @ camera_to_world.T
    assert lie_in(regions, at[:, :3], view).tolist() == [True, False]


def test_residual_starts_with_no_distractors():
    assert DistractorGaussians(CONFIG, cameras()).counts() == [0]


def test_what_distractors_own_reaches_a_cell_beyond_their_edge():
    alpha = torch.zeros(135, 240, 1)
    alpha[50:60, 100:120] = 0.6
    alpha[90:100] = 0.4
    owned = torch.zeros(135, 240, 1)
    owned[48:62, 98:122] = 0.6
    owned[88:102] = 0.4
    assert torch.equal(owned_share(alpha), owned)


def test_a_region_is_owned_whatever_covers_it():
    height, width = 90, 160
    columns, rows = grid_of(width, height)
    regions = torch.zeros(rows, columns, dtype=torch.bool)
    regions[:, : columns // 2] = True
    owned = owned_share(torch.full((height, width, 1), 0.25), regions)
    assert torch.equal(owned == 1, pixels_of(regions, height, width))
    assert (owned[owned != 1] == 0.25).all()


def test_the_interior_of_a_region_leaves_out_its_edge_but_not_the_images():
    expected = torch.zeros_like(block())
    expected[11:19, 31:49] = True
    assert torch.equal(interior(block()), expected)
    assert interior(torch.ones(5, 7, dtype=torch.bool)).all()
    assert not interior(torch.zeros(5, 7, dtype=torch.bool)).any()


@pytest.mark.parametrize("size", [(80, 120), (77, 111)])
def test_pixels_of_a_region(size):
    found = pixels_of(block(), *size)
    rows, columns = (torch.arange(n) * m // n for n, m in zip(size, (HEIGHT, WIDTH), strict=True))
    assert torch.equal(found[..., 0], block()[rows][:, columns])


class WellKnownScene:
    """Textured blocks, rendered with noise; every pixel has a Gaussian."""

    def __init__(self) -> None:
        self.generator = torch.Generator().manual_seed(0)
        blocks = torch.rand(HEIGHT // 4, WIDTH // 4, 3, generator=self.generator)
        self.photo = blocks.repeat_interleave(4, 0).repeat_interleave(4, 1)
        y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
        means2d = torch.stack([x, y], dim=-1).reshape(1, -1, 2) + 0.5
        radii = torch.ones(means2d.shape[:2]).int()
        self.info = {"means2d": means2d, "radii": radii, "width": WIDTH, "height": HEIGHT}
        self.opacities, self.state = torch.zeros(means2d.shape[1], 1), {}

    def rendered(self) -> torch.Tensor:
        return self.photo + 0.03 * torch.randn(self.photo.shape, generator=self.generator)

    def with_an_occluder(self) -> torch.Tensor:
        photo = self.photo.clone()
        photo[10:30, 20:40] = torch.tensor([0.9, 0.1, 0.9])
        return photo

    def with_a_pale_one(self) -> torch.Tensor:
        photo = self.photo.clone()
        photo[10:30, 20:40] += 0.2
        return photo


def test_an_occluder_of_one_view_is_found_on_a_scene_seen_often():
    scene = WellKnownScene()

    def regions(photo: torch.Tensor) -> torch.Tensor:
        rest = scene.opacities, scene.info, scene.state, 40, CONFIG
        return find_regions(0, scene.rendered(), photo, *rest)

    for _ in range(5):
        assert not regions(scene.photo).any()
    found = regions(scene.with_an_occluder())
    assert found.shape == (HEIGHT, WIDTH)
    true = torch.zeros_like(found)
    true[10:30, 20:40] = True
    assert (found & true).sum() / (found | true).sum() > 0.7


def test_a_pale_occluder_is_found_once_each_view_was_seen_often_and_none_is_densified():
    scene, views = WellKnownScene(), 5
    config = dataclasses.replace(CONFIG, settled_visits=4, stop_densify_at=1000)

    def regions(step: int, photo: torch.Tensor) -> torch.Tensor:
        rest = scene.opacities, scene.info, scene.state, views, config
        return find_regions(step, scene.rendered(), photo, *rest)

    for _ in range(4 * views - 1):
        assert not regions(1000, scene.photo).any()
    assert not regions(1000, scene.with_a_pale_one()).any()
    assert not regions(999, scene.with_a_pale_one()).any()
    assert regions(1000, scene.with_a_pale_one())[12:28, 22:38].all()
    assert not regions(1000, scene.photo).any()


@pytest.mark.parametrize("strong", [0.25, 0.4])
def test_the_advice_to_raise_strong_excess_helps_late_in_a_run_as_well(strong):
    config = DistractorConfig(strong_excess=strong)
    assert peak_excess(14999, 1000.0, config) == peak_excess(15000, 199.9, config) == strong
    assert peak_excess(15000, 200.0, config) == pytest.approx(0.6 * strong)


def test_distractors_keep_off_the_edge_of_a_region_and_are_free_further_in():
    scene, placement = WellKnownScene(), Placement(WARMED_UP, 40)

    def look(step: int, photo: torch.Tensor) -> tuple[Sighting, torch.Tensor | None]:
        seen = Sighting(0, the_view(), photo, torch.zeros(HEIGHT, WIDTH, 1))
        rest = scene.opacities, scene.info, scene.state
        return seen, placement.look(step, seen, scene.rendered(), *rest)

    for step in range(5):
        assert look(step, scene.photo)[1] is None
    seen, free = look(WARMED_UP.leave_out_at, scene.with_an_occluder())
    assert seen.left_out is not None
    assert seen.inside is not None
    assert free is not None
    assert torch.equal(seen.inside, interior(seen.left_out))
    assert torch.equal(free, pixels_of(interior(seen.inside), HEIGHT, WIDTH))
    assert 0 < free.sum() < seen.inside.sum() < seen.left_out.sum()
