"""Regions become distractors; what distractors cover is not the static scene's to fit."""

import dataclasses

import pytest
import torch
from nerfstudio.models.splatfacto import SplatfactoModelConfig

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.densification import DistractorDensifier
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.separation.ownership import pixels_of
from desplat_ns.separation.placement import (
    Placement,
    distractors_in,
    lie_in,
    uncovered_regions,
)
from desplat_ns.separation.visit import Visit
from tests.helpers.well_known_scene import (
    HEIGHT,
    WIDTH,
    WellKnownScene,
    cameras,
    nothing_drawn,
    the_view,
)

CONFIG = DistractorConfig(per_view=600, start="residual", initial_opacity=0.5, depth=0.5)
"""Cells of 2 x 2 pixels."""
WARMED_UP = dataclasses.replace(CONFIG, static_warmup=5, leave_out_at=10)


def sighting(inside: torch.Tensor, alpha: float = 0.0) -> Visit:
    visit = Visit(0, the_view(), nothing_drawn(), inside=inside)
    visit.photo = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(0))
    visit.alpha_d = torch.full((HEIGHT, WIDTH, 1), alpha)
    return visit


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
    new = distractors_in(uncovered_regions(seen, CONFIG).numpy(), seen, CONFIG)
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
    new = distractors_in(uncovered_regions(seen, CONFIG).numpy(), seen, CONFIG)
    assert torch.allclose(new["scales"], whole.params_of(0)["scales"][:50], atol=1e-6)


def test_none_is_placed_where_distractors_cover_already():
    assert not uncovered_regions(sighting(block(), alpha=0.6), CONFIG).any()
    assert uncovered_regions(sighting(block(), alpha=0.4), CONFIG).sum() == 50


def test_none_is_placed_in_a_cell_of_which_less_than_half_counts():
    seen = sighting(block())
    seen.mask = torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    seen.mask[:, 40:] = False
    seen.mask[10, 30:40] = False  # half of each cell of the uppermost row
    seen.mask[12:14, 30] = False
    seen.mask[12, 31] = False  # three quarters of a cell
    places = uncovered_regions(seen, CONFIG)
    assert places.sum() == 5 * 5 - 1
    assert places[5:10, 15:20].sum() == 5 * 5 - 1
    assert not places[6, 15]
    new = distractors_in(places.numpy(), seen, CONFIG)
    assert torch.allclose(new["rgbs"][0], seen.photo[11, 30:32].mean(0), atol=1e-6)


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


@pytest.mark.parametrize(
    ("views", "words"),
    [(2, "cannot be judged, and none is placed"), (4, "easily wrong"), (5, "")],
)
def test_too_few_photos_to_judge_by_are_told(views, words, capsys):
    Placement(WARMED_UP, views)
    text = " ".join(capsys.readouterr().out.split())
    assert words in text
    assert (f"There are {views} training photos" in text) == (views < 5)


def test_with_two_photos_nothing_is_placed_and_all_of_them_train():
    scene, placement = WellKnownScene(), Placement(WARMED_UP, 2)
    for _ in range(5):
        placement.look(0, scene.visit(scene.photo), scene.opacities, scene.memory)
    visit = scene.visit(scene.with_an_occluder())
    step = WARMED_UP.leave_out_at
    assert placement.look(step, visit, scene.opacities, scene.memory) is None
    assert visit.inside is None
    assert visit.left_out is None


def test_distractors_belong_in_the_whole_region_and_are_free_there():
    scene, placement = WellKnownScene(), Placement(WARMED_UP, 40)

    def look(step: int, photo: torch.Tensor) -> tuple[Visit, torch.Tensor | None]:
        visit = scene.visit(photo)
        free = placement.look(step, visit, scene.opacities, scene.memory)
        assert visit.learned is not None
        visit.learned.keep_in(scene.memory)
        return visit, free

    for step in range(5):
        assert look(step, scene.photo)[1] is None
    seen, free = look(WARMED_UP.leave_out_at, scene.with_an_occluder())
    assert seen.left_out is not None
    assert seen.inside is not None
    assert free is not None
    assert torch.equal(seen.inside, seen.left_out)
    assert torch.equal(free, pixels_of(seen.inside, HEIGHT, WIDTH))
    assert seen.inside.any()


def test_once_placing_has_stopped_none_comes_and_none_goes():
    scene, config = WellKnownScene(), dataclasses.replace(WARMED_UP, stop_placing_at=20)
    placement, distractors = Placement(config, 40), DistractorGaussians(config, cameras())
    densifier = DistractorDensifier(config, SplatfactoModelConfig(), num_views=1)
    optimizers: dict[str, torch.optim.Optimizer] = {
        name: torch.optim.Adam(params) for name, params in distractors.param_groups().items()
    }

    def number_after(step: int, photo: torch.Tensor) -> int:
        visit = scene.visit(photo)
        placement.look(step, visit, scene.opacities, scene.memory)
        assert visit.learned is not None
        visit.learned.keep_in(scene.memory)
        placement.place(visit, distractors, densifier, optimizers)
        return distractors.count_of(0)

    for step in range(5):
        assert number_after(step, scene.photo) == 0
    assert number_after(20, scene.with_an_occluder()) == 0
    placed = number_after(19, scene.with_an_occluder())
    assert placed > 0
    assert number_after(20, scene.photo) == placed
    assert number_after(19, scene.photo) == 0


def test_a_found_region_stays_with_less_evidence_also_after_a_checkpoint():
    """The occluder's colour comes nearer to the scene's, as where that begins to learn it."""
    scene, config = WellKnownScene(), dataclasses.replace(WARMED_UP, shared_detail=1.0)
    placement = Placement(config, 40)

    def look(placement: Placement, photo: torch.Tensor, step: int = 5) -> torch.Tensor:
        visit = scene.visit(photo)
        placement.look(step, visit, scene.opacities, scene.memory)
        placement.keep(visit)
        assert visit.inside is not None
        return visit.inside

    for _ in range(5):
        scene.find(scene.photo, 40, config)
    paler = scene.photo.clone()
    paler[10:30, 20:40] += 0.11
    assert not look(Placement(config, 40), paler).any()
    look(placement, scene.with_a_pale_one())
    resumed = Placement(config, 40)
    older = {"photos": {"found": {}, "photos": {}}}  # what checkpoints held once
    resumed.load_state_dict(older, torch.device("cpu"))
    resumed.load_state_dict(placement.state_dict() | older, torch.device("cpu"))
    for one in (placement, resumed):
        assert look(one, paler)[14:26, 24:36].all()
        assert not look(one, scene.photo).any()
    look(placement, scene.with_a_pale_one())
    forgetful = Placement(dataclasses.replace(config, standing_share=1.0), 40)
    forgetful.load_state_dict(placement.state_dict(), torch.device("cpu"))
    assert not look(forgetful, paler).any()
    assert not look(placement, paler, config.leave_out_at).any()
