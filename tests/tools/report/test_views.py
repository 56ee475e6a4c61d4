"""What the photos see: places that most do not show, and what one photo alone shows."""

from dataclasses import replace

import torch

from desplat_ns.backend.protocol import View
from desplat_ns.separation.decide import Thresholds
from desplat_ns.tools.report.views import Unlike, alone, apart, disputed_places, unlike_in

WIDTH, HEIGHT, VIEWS = 80, 60, 20


def view(index: int) -> View:
    """Cameras side by side, 10 units before a wall at z = 0 that moves 2 pixels per view."""
    viewmat = torch.eye(4)
    viewmat[0, 3], viewmat[2, 3] = 0.5 * (index - VIEWS / 2), 10.0
    K = torch.tensor([[40.0, 0.0, WIDTH / 2], [0.0, 40.0, HEIGHT / 2], [0.0, 0.0, 1.0]])
    return View(viewmat, K, WIDTH, HEIGHT)


def wall() -> torch.Tensor:
    x, y = torch.meshgrid(torch.linspace(-7, 7, 60), torch.linspace(-6, 6, 50), indexing="xy")
    return torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3)


def covered(index: int, left: float, width: float) -> torch.Tensor:
    """alpha_d of something over the wall's columns from `left` on, in world units."""
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    start = round(WIDTH / 2 + 4 * (left + 0.5 * (index - VIEWS / 2)))
    alpha[:, max(0, start) : max(0, start + round(4 * width))] = 0.9
    return alpha


def of_photo(index: int, alpha: torch.Tensor, photo: torch.Tensor | None = None) -> Unlike:
    """Of a photo that shows the static scene, or of another one; the scene is grey."""
    grey = torch.full((HEIGHT, WIDTH, 3), 0.5)
    shown = grey if photo is None else photo
    return unlike_in(f"{index:02}.jpg", view(index), alpha, shown, grey, Thresholds())


def test_something_elsewhere_in_each_photo_disputes_nothing():
    photos = [of_photo(i, covered(i, -6 + (i * 7 % VIEWS) / 2, 3.0)) for i in range(VIEWS)]
    assert disputed_places(wall(), photos) is None
    assert disputed_places(wall(), []) is None


def test_what_distractors_cover_in_most_photos_is_found_with_the_photos():
    photos = [of_photo(i, covered(i, -1.0, 2.0 if i >= 4 else 0.0)) for i in range(VIEWS)]
    found = disputed_places(wall(), photos)
    assert found is not None
    assert sorted(found.names) == [f"{i:02}.jpg" for i in range(4, VIEWS)]


def test_what_most_photos_do_not_show_is_found_with_its_place_though_nothing_covers_it():
    """Something stands there, of another colour in each photo."""
    photos, places = [], {}
    for i in range(VIEWS):
        place = covered(i, -1.0, 2.0 if i % 5 else 0.0) > 0.5
        color = torch.rand(3, generator=torch.Generator().manual_seed(i)).round()
        photo = torch.where(place, color, torch.tensor(0.5))
        photos.append(of_photo(i, torch.zeros(HEIGHT, WIDTH, 1), photo))
        places[photos[-1].name] = place[..., 0]
    found = disputed_places(wall(), photos)
    assert found is not None
    where = torch.from_numpy(found.where).float()[None, None]
    marked = torch.nn.functional.interpolate(where, (HEIGHT, WIDTH))[0, 0] > 0.5
    place = places[found.names[0]]
    place[:6], place[54:] = False, False  # above and below the wall, where no place is
    assert (marked & place).sum() > 0.7 * (marked | place).sum()


def test_a_place_counts_where_it_is_seen():
    """Half of the image is covered; a point before each half, one behind the camera, one lost."""
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, : WIDTH // 2] = 0.6
    means = torch.tensor([[-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, -20], [float("nan"), 0, 0]])
    photo = replace(of_photo(VIEWS // 2, alpha), view=view(VIEWS // 2))
    finer = replace(photo, cells=photo.cells.repeat_interleave(2, dim=0))  # of another size
    found = disputed_places(means, [photo] * 3 + [finer] * 2)
    assert found is not None and found.share == 0.5  # of two places
    assert found.where.sum() == 1
    assert disputed_places(means, [photo] * 4) is None  # too few to judge


def test_a_photo_that_shows_a_place_alone_is_named_with_its_share():
    shown = torch.tensor([[1, 1, 0, 0], [1, 1, 1, 1], [0, 1, 0, 0]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg", "c.jpg"], shown) == {"b.jpg": 0.5}
    twice_or_never = torch.tensor([[1, 0, 1], [1, 0, 1]], dtype=torch.bool)
    assert alone(["a.jpg", "b.jpg"], twice_or_never) == {}


def test_photos_that_share_nothing_are_of_different_places():
    shown = torch.zeros(5, 400, dtype=torch.bool)
    for photo, (first, last) in enumerate([(0, 100), (95, 200), (200, 300), (298, 400), (0, 0)]):
        shown[photo, first:last] = True
    assert apart(list("abcde"), shown) == [["a", "b"], ["c", "d"]]
