"""Warnings about distractors that hide the scene, and silence where they do not."""

import re

import pytest
import torch

from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.separation.failure_cases import (
    MIN_INTERVAL,
    SeparationWatch,
    hidden_places,
    sight_of,
)

WIDTH, HEIGHT, VIEWS = 80, 60, 20
STEP = MIN_INTERVAL


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


def watch(**config) -> SeparationWatch:
    config = DistractorConfig(static_warmup=50, stop_densify_at=200, **config)
    return SeparationWatch(config, [f"photo_{i:02}[a].jpg" for i in range(VIEWS)], VIEWS)


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_something_elsewhere_in_each_photo_is_no_reason_for_a_warning(capsys):
    one = watch()
    for index in range(VIEWS):
        one.see(index, sight_of(view(index), covered(index, -6 + (index * 7 % VIEWS) / 2, 3.0)))
    one.look(STEP, wall())
    assert said(capsys) == ""


def test_something_that_stays_in_most_photos_is_told_once_with_photos_and_options(capsys):
    one = watch(start="residual")
    for index in range(VIEWS):
        alpha = covered(index, -1.0, 2.0 if index >= 4 else 0.0)
        one.see(index, sight_of(view(index), alpha))
    one.look(STEP, wall())
    text = said(capsys)
    assert "of the static scene is behind distractors in most of the photos" in text
    named = [int(number) for number in re.findall(r"photo_(\d\d)\[a\]\.jpg", text)]
    assert len(named) == 5 and min(named) >= 4
    assert "and 11 more" in text
    assert "--pipeline.model.distractors.strong-excess (now 0.25)" in text
    one.look(2 * STEP, wall())
    assert said(capsys) == ""


def test_distractors_over_most_of_most_photos_are_told(capsys):
    one = watch()
    for index in range(VIEWS):
        full = torch.full((HEIGHT, WIDTH, 1), 0.9 if index < 12 else 0.1)
        one.see(index, sight_of(view(index), full))
    one.look(STEP, wall())
    text = said(capsys)
    assert "cover more than 50% of 12 of 20 photos" in text
    assert "a higher --pipeline.model.distractors.lambda-d (now 0.01)" in text


def test_what_is_noticed_can_be_asked_for_at_any_time_and_again(capsys):
    one = watch()
    assert one.notice(wall()) is None
    for index in range(VIEWS):
        one.see(index, sight_of(view(index), torch.full((HEIGHT, WIDTH, 1), 0.9)))
    first = one.notice(wall())
    assert first is not None and first == one.notice(wall())
    assert first[0] == "too many" and first[1].startswith("distractors cover more than 50%")
    assert said(capsys) == ""


def test_nothing_is_said_before_distractors_have_settled_or_most_views_were_seen(capsys):
    one = watch()
    full = torch.full((HEIGHT, WIDTH, 1), 0.9)
    for index in range(VIEWS // 2):
        one.see(index, sight_of(view(index), full))
    one.look(STEP, wall())
    assert said(capsys) == ""
    one.see(19, sight_of(view(19), full))
    one.start = STEP + 1
    one.look(STEP, wall())
    assert said(capsys) == ""
    one.start = STEP
    one.look(STEP, wall())
    assert "cover more than 50%" in said(capsys)


def test_a_place_counts_where_it_is_seen():
    """Half of the image is covered; a point before each half, one behind the camera, one lost."""
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, : WIDTH // 2] = 0.6
    means = torch.tensor([[-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, -20], [float("nan"), 0, 0]])
    middle = view(VIEWS // 2)
    share, counts = hidden_places(means, [sight_of(middle, alpha)] * 8)
    assert share == 0.5  # of two places
    assert counts.tolist() == [1.0] * 8
    assert hidden_places(means, [sight_of(middle, alpha)] * 7)[0] == 0.0  # too few to judge
