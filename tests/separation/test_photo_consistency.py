"""What a photo shows and the other photos do not is told from the photos alone."""

import math

import pytest
import torch

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.separation.grid import grid_of
from desplat_ns.separation.photo_consistency import (
    CELLS,
    NEIGHBOURS,
    UNKNOWN,
    CellPhoto,
    ComparedPhotos,
    contradiction,
    nearest,
)
from desplat_ns.separation.visit import Visit

WIDTH, HEIGHT, FOCAL, DEPTH = 96, 64, 80.0, 3.0
BLOCK = (slice(20, 44), slice(36, 64))
"""Rows and columns of something that stands in one photo."""


def view_at(x: float, turn: float = 0.0) -> View:
    """At (x, 0, 0), looking along z, turned about y by `turn` radians."""
    cos, sin = math.cos(turn), math.sin(turn)
    rotation = torch.tensor([[cos, 0.0, -sin], [0, 1, 0], [sin, 0, cos]])
    viewmat = torch.eye(4)
    viewmat[:3, :3] = rotation
    viewmat[:3, 3] = -rotation @ torch.tensor([x, 0.0, 0.0])
    K = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    return View(viewmat, K, WIDTH, HEIGHT)


def photo_of_wall(view: View, wall: float) -> torch.Tensor:
    """A photo of a coloured wall at depth `wall`; infinity: of colours that depend on the direction
    alone."""
    y, x = torch.meshgrid(torch.arange(HEIGHT) + 0.5, torch.arange(WIDTH) + 0.5, indexing="ij")
    rays = torch.stack([x - WIDTH / 2, y - HEIGHT / 2, torch.full_like(x, FOCAL)], dim=-1)
    rays = (rays / FOCAL) @ view.viewmat[:3, :3]  # world axes
    centre = -view.viewmat[:3, :3].T @ view.viewmat[:3, 3]
    at = rays / rays[..., 2:] + (centre / wall if math.isfinite(wall) else 0.0)
    u, v = at[..., 0], at[..., 1]
    colors = [torch.sin(3 * u + 1), torch.sin(4 * v + 2), torch.sin(2 * u + 5 * v)]
    return 0.5 + 0.3 * torch.stack(colors, dim=-1)


def visit_of(
    index: int, view: View, wall: float = DEPTH, mask: torch.Tensor | None = None
) -> Visit:
    blank = torch.zeros(HEIGHT, WIDTH, 1)
    drawn = Rendering(
        blank.expand(-1, -1, 3), blank, None, torch.zeros(1, 1, 2), torch.ones(1).int()
    )
    visit = Visit(index, view, drawn, mask=mask)
    visit.photo = photo_of_wall(view, wall)
    return visit


def visits(wall: float = DEPTH) -> list[Visit]:
    return [visit_of(i, view_at(0.15 * i - 0.3, 0.02 * i), wall) for i in range(5)]


def compared(all_visits: list[Visit], index: int) -> torch.Tensor:
    photos = [CellPhoto.of(visit) for visit in all_visits]
    others = [photo for i, photo in enumerate(photos) if i != index]
    depth = torch.tensor(DEPTH)
    return contradiction(photos[index], nearest(photos[index], others, depth), depth)


def well_seen(found: torch.Tensor) -> torch.Tensor:
    """Without the borders: what they show is in fewer than three of the other photos."""
    border = found.shape[1] // 5
    return found[2:-2, border:-border]


def blocked(visit: Visit) -> torch.Tensor:
    """Put something of another colour into a photo; the cells that it covers."""
    visit.photo[BLOCK] = torch.tensor([1.0, 0.0, 1.0])
    covered = torch.zeros(HEIGHT, WIDTH)
    covered[BLOCK] = 1
    columns, rows = grid_of(WIDTH, HEIGHT, CELLS)
    cells = torch.nn.functional.adaptive_avg_pool2d(covered[None], (rows, columns))[0]
    return cells == 1


@pytest.mark.parametrize("wall", [2.0, 10.0, math.inf])
def test_a_wall_at_any_depth_contradicts_nobody(wall: float):
    assert well_seen(compared(visits(wall), 2)).max() < 0.05


def test_something_in_one_photo_contradicts_the_others_and_the_rest_of_the_photo_does_not():
    scene = visits()
    cells = blocked(scene[2])
    found = compared(scene, 2)
    assert found[cells].min() > 0.2
    beside = torch.nn.functional.max_pool2d(cells[None].float(), 5, 1, 2)[0] == 0
    assert well_seen(found.masked_fill(~beside, 0.0)).max() < 0.05


def test_photos_without_it_are_not_accused_by_the_one_that_has_it():
    scene = visits()
    blocked(scene[2])
    assert well_seen(compared(scene, 1)).max() < 0.05


def test_what_a_user_masks_in_the_other_photos_says_nothing():
    scene = visits()
    middle = (slice(15, 25), slice(20, 30))
    for visit in (scene[0], *scene[3:]):
        visit.photo[:] = torch.tensor([1.0, 0.0, 1.0])
    assert compared(scene, 2)[middle].min() > 0.2  # three of four show something else everywhere
    for visit in (scene[0], *scene[3:]):
        visit.mask = torch.zeros(HEIGHT, WIDTH, 1, dtype=torch.bool)
        visit.mask[:10] = True
    assert (compared(scene, 2)[middle] == UNKNOWN).all()  # one is left
    scene += [visit_of(5 + i, view_at(0.1 * i - 0.2)) for i in range(2)]
    assert compared(scene, 2)[middle].max() < 0.05


@pytest.mark.parametrize("others", [0, 1])
def test_with_few_other_photos_nothing_is_known(others: int):
    photos = [CellPhoto.of(visit) for visit in visits()]
    found = contradiction(photos[0], photos[1 : 1 + others], torch.tensor(DEPTH))
    assert (found == UNKNOWN).all()


def test_places_that_no_other_photo_shows_are_not_well_seen():
    away = [visit_of(i, view_at(0.0, math.pi)) for i in range(3)]
    assert (compared([visit_of(9, view_at(0.0)), *away], 0) == UNKNOWN).all()


def test_the_photos_taken_nearest_are_asked():
    photos = [CellPhoto.of(visit_of(i, view_at(0.1 * i))) for i in range(12)]
    asked = nearest(photos[0], photos[1:], torch.tensor(DEPTH))
    assert [id(photo) for photo in asked] == [id(photo) for photo in photos[1 : 1 + NEIGHBOURS]]
    assert nearest(photos[0], [], torch.tensor(DEPTH)) == []


def test_nothing_is_said_before_all_photos_were_seen_and_then_in_the_cells_of_residuals():
    photos, means = ComparedPhotos(5), torch.tensor([[0.0, 0.0, DEPTH]])
    scene = visits()
    for visit in scene[:4]:
        photos.keep(visit)
        assert photos.compare(visit, means) is None
    photos.keep(scene[4])
    found = photos.compare(scene[2], means)
    columns, rows = grid_of(WIDTH, HEIGHT)
    assert found is not None and found.shape == (rows, columns)
    assert well_seen(found).max() < 0.05


def test_a_visit_that_is_thrown_away_leaves_nothing_behind():
    photos, means = ComparedPhotos(5), torch.tensor([[0.0, 0.0, DEPTH]])
    for visit in visits():
        photos.keep(visit)
    before = photos.state_dict()
    assert photos.compare(visits()[2], means) is not None
    assert photos.state_dict()["found"] == before["found"] == {}


def test_a_checkpoint_has_what_was_found_and_the_photos_that_are_still_needed():
    before, after, means = ComparedPhotos(5), ComparedPhotos(5), torch.tensor([[0.0, 0.0, DEPTH]])
    scene = visits()
    scene[1].mask = torch.ones(HEIGHT, WIDTH, 1, dtype=torch.bool)
    blocked(scene[2])
    for visit in scene:
        before.keep(visit)
    found = before.compare(scene[2], means)
    after.load_state_dict(before.state_dict(), torch.device("cpu"))
    for visit in scene:
        one, other = (photos.compare(visit, means) for photos in (before, after))
        assert one is not None and other is not None and torch.equal(one, other)
        after.keep(visit)
    state = after.state_dict()
    assert not state["photos"]
    last = ComparedPhotos(5)
    last.load_state_dict(state, torch.device("cpu"))
    again = last.compare(scene[2], means)
    assert found is not None and again is not None and torch.equal(found, again)
