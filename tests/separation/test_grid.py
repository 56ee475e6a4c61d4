"""Cells are square, and no smaller than a pixel."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.separation.grid import grid_of, pooled


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
