"""Cells are square, and no smaller than a pixel."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.separation.grid import (
    counted_cells,
    grid_of,
    pooled,
    window_means,
    window_sums,
)


@pytest.mark.parametrize(
    ("width", "height"), [(240, 135), (1920, 1080), (20, 10), (1, 1), (9, 900)]
)
def test_a_grid_has_square_cells_not_smaller_than_a_pixel(width, height):
    columns, rows = grid_of(width, height)
    assert 1 <= columns <= width
    assert 1 <= rows <= height
    if width * height > 8000 * 4 and min(width, height) > 100:
        assert columns * rows == pytest.approx(8000, rel=0.02)
        assert columns / rows == pytest.approx(width / height, rel=0.02)


def test_pooling_takes_means():
    image = torch.arange(24.0).reshape(4, 6, 1)
    assert torch.equal(pooled(image, (3, 2)), image.reshape(2, 2, 3, 2).mean((1, 3))[None])


def test_pooling_takes_means_of_the_pixels_that_count():
    image = torch.tensor([[[1.0], [2.0], [5.0], [7.0]]])
    mask = torch.tensor([[[True], [False], [False], [False]]])
    assert pooled(image, (2, 1), mask).tolist() == [[[1.0, 0.0]]]
    whole = torch.rand(20, 30, 3, generator=torch.Generator().manual_seed(0))
    everything = torch.ones(20, 30, 1, dtype=torch.bool)
    assert torch.equal(pooled(whole, (7, 5), everything), pooled(whole, (7, 5)))


def test_a_cell_counts_if_half_of_its_pixels_do():
    mask = torch.tensor([[1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 1, 0]], dtype=torch.bool)[..., None]
    assert counted_cells(mask, (3, 1)).tolist() == [[True, True, False]]


@pytest.mark.parametrize("size", [1, 3, 13])
def test_windows_are_summed_as_far_as_they_are_in_the_image(size):
    cells = torch.rand(2, 9, 11, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    sums, half = torch.empty_like(cells), size // 2
    means = torch.empty_like(cells)
    for i in range(9):
        for j in range(11):
            rows, columns = (slice(max(0, k - half), k + half + 1) for k in (i, j))
            sums[:, i, j] = cells[:, rows, columns].sum((1, 2))
            means[:, i, j] = cells[:, rows, columns].mean((1, 2))
    torch.testing.assert_close(window_sums(cells, size), sums)
    torch.testing.assert_close(window_means(cells, size), means)
