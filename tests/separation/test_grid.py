"""Cells are square, and no smaller than a pixel; what goes to the host and back is as it was."""

import pytest
import torch

from desplat_ns.separation.grid import grid_of, pooled, region_pixels, window_means


@pytest.mark.parametrize(("width", "height"), [(240, 135), (1920, 1080), (1, 1), (9, 900)])
def test_a_grid_has_square_cells_not_smaller_than_a_pixel(width, height):
    columns, rows = grid_of(width, height)
    assert 1 <= columns <= width
    assert 1 <= rows <= height
    if width * height > 8000 * 4 and min(width, height) > 100:
        assert columns * rows == pytest.approx(8000, rel=0.02)
        assert columns / rows == pytest.approx(width / height, rel=0.02)


def test_a_pixel_counts_in_each_cell_by_the_part_that_lies_there():
    image = torch.tensor([[0.0, 6.0, 12.0]])[..., None]  # cells of one and a half pixels
    assert pooled(image, (2, 1)).flatten().tolist() == pytest.approx([2.0, 10.0])


@pytest.mark.parametrize("size", [(96, 132, 3), (97, 131, 3), (3, 5, 2)])
def test_a_gpu_takes_the_same_means_by_other_ways(size, monkeypatch):
    """The branch for other devices, run on the CPU: sums of 1e4 values in [0, 1], float32. Cells of
    whole pixels are averaged alike; others are off by half a pixel's slope at most."""
    columns, rows = grid = size[1] // 2, size[0] // 2
    image, allowed = torch.rand(size, generator=torch.Generator().manual_seed(0)), 1e-5
    if (rows * 2, columns * 2) != size[:2]:
        image = 0.01 * torch.arange(size[1])[None, :, None].expand(size).float()
        allowed = 0.01 / 2
    means = pooled(image, grid)
    windows = window_means(means, 3)
    monkeypatch.setattr(torch.Tensor, "is_cpu", False)
    torch.testing.assert_close(pooled(image, grid), means, atol=allowed, rtol=0)
    torch.testing.assert_close(window_means(means, 3), windows, atol=1e-5, rtol=0)


@pytest.mark.parametrize("size", [3, 13])
def test_windows_are_averaged_as_far_as_they_are_in_the_image(size):
    cells = torch.rand(2, 9, 11, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    means, half = torch.empty_like(cells), size // 2
    for i in range(9):
        for j in range(11):
            rows, columns = (slice(max(0, k - half), k + half + 1) for k in (i, j))
            means[:, i, j] = cells[:, rows, columns].mean((1, 2))
    torch.testing.assert_close(window_means(cells, size), means)


@pytest.mark.parametrize("size", [(97, 131), (1, 2000)])
def test_a_gpu_takes_the_same_pixels_by_other_ways(size, monkeypatch):
    columns, rows = grid_of(size[1], size[0])
    regions = torch.rand(rows, columns, generator=torch.Generator().manual_seed(0)) < 0.5
    pixels = region_pixels(regions, *size)
    monkeypatch.setattr(torch.Tensor, "is_cpu", False)
    assert torch.equal(region_pixels(regions, *size), pixels)
