"""The grid of cells on which residuals and regions are computed, whatever the size of a photo."""

from __future__ import annotations

import math

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

CELLS = 8000
"""Cells per image: 2 x 2 pixels at 135 x 240."""


def grid_of(width: int, height: int, cells: int = CELLS) -> tuple[int, int]:
    """Columns and rows of about `cells` square cells, none smaller than a pixel."""
    size = max(1.0, math.sqrt(width * height / cells))
    return max(1, round(width / size)), max(1, round(height / size))


def pooled(image: Float[Tensor, "H W C"], grid: tuple[int, int]) -> Float[Tensor, "C rows columns"]:
    """Mean of an image over each cell of a grid of (columns, rows)."""
    return F.adaptive_avg_pool2d(image.permute(2, 0, 1)[None], (grid[1], grid[0]))[0]
