"""Another light keeps the scene's detail; a thing in front has its own, or none."""

import pytest
import torch

from desplat_ns.separation import decide
from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled

HEIGHT, WIDTH = 120, 160
RECTANGLE = (slice(24, 100), slice(36, 134))
"""Pixels that are changed."""


@pytest.fixture
def scene() -> torch.Tensor:
    torch.manual_seed(0)
    coarse = torch.rand(1, 1, HEIGHT // 5, WIDTH // 5)
    fine = torch.nn.functional.interpolate(coarse, size=(HEIGHT, WIDTH), mode="bicubic")
    return fine[0].clamp(0, 1).permute(1, 2, 0) * torch.tensor([0.9, 0.8, 0.7])


def shared_detail(static: torch.Tensor, photo: torch.Tensor) -> torch.Tensor:
    """On the grid of `grid_of`."""
    size = static.shape[1], static.shape[0]
    fine = fine_grid_of(*size)
    detail = decide.shared_detail(pooled(static, fine), pooled(photo, fine))
    return pooled(detail[..., None], grid_of(*size))[0]


def inner(cells: torch.Tensor) -> torch.Tensor:
    """The cells inside of what was changed."""
    columns, rows = grid_of(WIDTH, HEIGHT)
    down, right = RECTANGLE
    y = slice(down.start * rows // HEIGHT + 4, down.stop * rows // HEIGHT - 4)
    x = slice(right.start * columns // WIDTH + 4, right.stop * columns // WIDTH - 4)
    return cells[y, x]


@pytest.mark.parametrize(("gain", "offset"), [(0.7, 0.0), (1.3, 0.0), (0.8, 0.3)])
def test_a_light_keeps_the_detail(scene, gain, offset):
    photo = scene.clone()
    photo[RECTANGLE] = photo[RECTANGLE] * gain + offset
    assert (inner(shared_detail(scene, photo)) > 0.7).float().mean() > 0.95


def test_what_has_no_detail_or_another_shares_none(scene):
    flat, other = scene.clone(), scene.clone()
    flat[RECTANGLE] = 0.5
    other[RECTANGLE] = scene.flip(0, 1)[RECTANGLE]
    assert inner(shared_detail(scene, flat)).abs().max() < 0.01
    assert inner(shared_detail(scene, other)).mean() < 0.3


def test_it_is_the_correlation_of_the_windows_by_a_count_of_its_own(scene):
    """Against sums over the windows one by one, in float64; at this size a cell is a pixel."""
    static, photo = scene[:8, :8], scene.flip(1)[:8, :8] * 0.5
    s, p = (image.double().mean(-1) for image in (static, photo))

    def means(x: torch.Tensor, size: int) -> torch.Tensor:
        half = size // 2
        averages = torch.empty_like(x)
        for i in range(8):
            for j in range(8):
                window = x[max(0, i - half) : i + half + 1, max(0, j - half) : j + half + 1]
                averages[i, j] = window.mean()
        return averages

    s, p = means(s, 3), means(p, 3)
    common = means(s * p, 7) - means(s, 7) * means(p, 7)
    of_static, of_photo = (means(x * x, 7) - means(x, 7) ** 2 + 1e-3 for x in (s, p))
    expected = common / (of_static * of_photo).sqrt()
    torch.testing.assert_close(shared_detail(static, photo).double(), expected, atol=1e-3, rtol=0)
