"""What hides the scene is told, and what does not is not."""

import re
from dataclasses import replace

import torch

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.report.failure_case import Coverage, coverage_of, disputed_places, failure_case
from desplat_ns.separation.regions import apply_mask

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


CONFIG = DistractorConfig(start="residual", strong_excess=0.15, lambda_d=0.02)


def of_photo(index: int, alpha: torch.Tensor, photo: torch.Tensor | None = None) -> Coverage:
    """Of a photo that shows the static scene, or of another one; what is grey is nothing."""
    grey = torch.full((HEIGHT, WIDTH, 3), 0.5)
    shown = grey if photo is None else photo
    return coverage_of(f"photo_{index:02}[a].jpg", view(index), alpha, shown, grey, CONFIG)


def everywhere(alpha: float) -> torch.Tensor:
    return torch.full((HEIGHT, WIDTH, 1), alpha)


def test_nothing_known_is_no_failure():
    assert failure_case(CONFIG, wall(), []) is None


def test_something_elsewhere_in_each_photo_is_no_failure():
    views = [of_photo(i, covered(i, -6 + (i * 7 % VIEWS) / 2, 3.0)) for i in range(VIEWS)]
    assert failure_case(CONFIG, wall(), views) is None


def test_what_distractors_cover_in_most_photos_is_told_with_the_photos():
    views = [of_photo(i, covered(i, -1.0, 2.0 if i >= 4 else 0.0)) for i in range(VIEWS)]
    failure = failure_case(CONFIG, wall(), views)
    assert failure is not None
    named = [int(number) for number in re.findall(r"photo_(\d\d)\[a\]\.jpg", failure.what)]
    assert len(named) == 5 and min(named) >= 4
    assert "and 11 more" in failure.what


def test_what_most_photos_do_not_show_is_told_with_its_place_though_nothing_covers_it():
    """Something stands there, of another colour in each photo."""
    views, places = [], []
    for i in range(VIEWS):
        place = covered(i, -1.0, 2.0 if i % 5 else 0.0) > 0.5
        color = torch.rand(3, generator=torch.Generator().manual_seed(i)).round()
        photo = torch.where(place, color, torch.tensor(0.5))
        views.append(of_photo(i, everywhere(0.0), photo))
        places.append(place)
    failure = failure_case(CONFIG, wall(), views)
    assert failure is not None and failure.where is not None
    where = torch.from_numpy(failure.where).float()[None, None]
    marked = torch.nn.functional.interpolate(where, (HEIGHT, WIDTH))[0, 0] > 0.5
    place = places[[coverage.name for coverage in views].index(failure.name)][..., 0]
    place[:6], place[54:] = False, False  # above and below the wall, where no place is
    assert (marked & place).sum() > 0.7 * (marked | place).sum()


def test_a_user_s_mask_decides_what_a_photo_shows():
    """As `report.pictures` has it: a photo shows the static scene where the mask leaves it out."""
    grey, place = torch.full((HEIGHT, WIDTH, 3), 0.5), covered(0, -1.0, 2.0) > 0.5
    photo = torch.where(place, torch.tensor([1.0, 0.0, 1.0]), grey)
    assert of_photo(0, everywhere(0.0), photo).unlike.any()
    seen, _ = apply_mask(photo, grey, ~place)
    assert not of_photo(0, everywhere(0.0), seen).unlike.any()


def test_distractors_over_most_of_most_photos_are_told():
    views = [of_photo(i, everywhere(0.9 if i < 12 else 0.1)) for i in range(VIEWS)]
    failure = failure_case(CONFIG, wall(), views)
    assert failure is not None and failure.where is None
    assert failure.what.startswith("Distractors cover more than 50% of 12 of 20")
    assert "lambda-d (now 0.02)" in failure.advice


def test_a_place_counts_where_it_is_seen():
    """Half of the image is covered; a point before each half, one behind the camera, one lost."""
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, : WIDTH // 2] = 0.6
    means = torch.tensor([[-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, -20], [float("nan"), 0, 0]])
    middle = view(VIEWS // 2)
    coverage = of_photo(VIEWS // 2, alpha)
    coverages = [replace(coverage, view=middle)] * 5
    share, cells = disputed_places(means, coverages)
    assert share == 0.5  # of two places
    assert cells.sum(dim=1).tolist() == [1] * 5
    assert disputed_places(means, coverages[:4])[0] == 0.0  # too few to judge
