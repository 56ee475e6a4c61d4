"""What hides the scene is told, and what does not is not."""

import re

import torch

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.report.failure_case import Coverage, coverage_of, failure_case, hidden_places

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


def of_photo(index: int, alpha: torch.Tensor) -> Coverage:
    return coverage_of(f"photo_{index:02}[a].jpg", view(index), alpha)


def everywhere(alpha: float) -> torch.Tensor:
    return torch.full((HEIGHT, WIDTH, 1), alpha)


def test_nothing_known_is_no_failure():
    assert failure_case(DistractorConfig(), wall(), []) is None


def test_something_elsewhere_in_each_photo_is_no_failure():
    views = [of_photo(i, covered(i, -6 + (i * 7 % VIEWS) / 2, 3.0)) for i in range(VIEWS)]
    assert failure_case(DistractorConfig(), wall(), views) is None


def test_something_that_stays_in_most_photos_is_told_with_photos_and_options():
    views = [of_photo(i, covered(i, -1.0, 2.0 if i >= 4 else 0.0)) for i in range(VIEWS)]
    text = failure_case(DistractorConfig(start="residual", strong_excess=0.3), wall(), views)
    assert text is not None
    assert "of the static scene is behind distractors in most of the photos" in text
    named = [int(number) for number in re.findall(r"photo_(\d\d)\[a\]\.jpg", text)]
    assert len(named) == 5 and min(named) >= 4
    assert "and 11 more" in text
    assert "--pipeline.model.distractors.strong-excess (now 0.3)" in text


def test_distractors_over_most_of_most_photos_are_told():
    views = [of_photo(i, everywhere(0.9 if i < 12 else 0.1)) for i in range(VIEWS)]
    text = failure_case(DistractorConfig(lambda_d=0.02), wall(), views)
    assert text is not None and text.startswith("distractors cover more than 50% of 12 of 20")
    assert "a higher --pipeline.model.distractors.lambda-d (now 0.02)" in text


def test_a_place_counts_where_it_is_seen():
    """Half of the image is covered; a point before each half, one behind the camera, one lost."""
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, : WIDTH // 2] = 0.6
    means = torch.tensor([[-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, -20], [float("nan"), 0, 0]])
    middle = view(VIEWS // 2)
    share, counts = hidden_places(means, [coverage_of("a", middle, alpha)] * 8)
    assert share == 0.5  # of two places
    assert counts.tolist() == [1.0] * 8
    assert hidden_places(means, [coverage_of("a", middle, alpha)] * 7)[0] == 0.0  # too few to judge
