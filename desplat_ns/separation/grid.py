"""The grid of cells on which residuals and regions are computed, whatever the size of a photo."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

CELLS = 8000
"""Cells per image: 2 x 2 pixels at 135 x 240."""

COUNTED_SHARE = 0.5
"""A cell is masked if less than this share of its pixels counts."""


def grid_of(width: int, height: int, cells: int = CELLS) -> tuple[int, int]:
    """Columns and rows of about `cells` square cells, none smaller than a pixel."""
    size = max(1.0, math.sqrt(width * height / cells))
    return max(1, round(width / size)), max(1, round(height / size))


def pooled(
    image: Float[Tensor, "H W C"],
    grid: tuple[int, int],
    mask: Bool[Tensor, "H W 1"] | None = None,
) -> Float[Tensor, "C rows columns"]:
    """Mean of an image over each cell of a grid of (columns, rows).

    Args:
        mask: True in the pixels that count, None if all do; a cell in which none does gets 0.
    """
    if mask is not None:
        both = torch.cat([image.masked_fill(~mask, 0.0), mask.to(image)], dim=-1)
        sums = pooled(both, grid)
        return sums[:-1] / sums[-1:].clamp(min=torch.finfo(image.dtype).tiny)
    return F.adaptive_avg_pool2d(image.permute(2, 0, 1)[None], (grid[1], grid[0]))[0]


def counted_cells(
    mask: Bool[Tensor, "H W 1"], grid: tuple[int, int]
) -> Bool[Tensor, "rows columns"]:
    """The cells of a grid of (columns, rows) that are not masked; `mask`: True where it counts."""
    return pooled(mask.to(torch.float32), grid)[0] >= COUNTED_SHARE


def window_sums(
    cells: Float[Tensor, "C rows columns"], size: int
) -> Float[Tensor, "C rows columns"]:
    """Sums over windows of `size` x `size` cells (an odd number), as far as they are in the image.

    From running sums along columns and rows, so that a wide window takes no longer than a narrow
    one. They are as exact as the sum of a whole column: for values of like size, such as colours.
    """
    return _sums_along(_sums_along(cells, size, 2), size, 1)


def window_means(
    cells: Float[Tensor, "C rows columns"], size: int
) -> Float[Tensor, "C rows columns"]:
    """Means over windows as `window_sums` has them."""
    return window_sums(cells, size) / window_sums(torch.ones_like(cells[:1]), size)


def _sums_along(cells: Tensor, size: int, dim: int) -> Tensor:
    count, half = cells.shape[dim], size // 2
    running = F.pad(cells, [0, 0] * (2 - dim) + [half + 1, half]).cumsum(dim)
    return running.narrow(dim, size, count) - running.narrow(dim, 0, count)
