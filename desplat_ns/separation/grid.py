"""The grid of cells on which residuals and regions are computed, whatever the size of a photo.
Means are OpenCV's on a CPU, torch's on a GPU."""

import math
from functools import lru_cache

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, Shaped
from torch import Tensor

CELLS = 8000
"""Cells per image: 2 x 2 pixels at 135 x 240."""


def grid_of(width: int, height: int, cells: int = CELLS) -> tuple[int, int]:
    """Columns and rows of about `cells` square cells, none smaller than a pixel."""
    size = max(1.0, math.sqrt(width * height / cells))
    return max(1, round(width / size)), max(1, round(height / size))


def fine_grid_of(width: int, height: int) -> tuple[int, int]:
    """`grid_of` with cells of half the size, or of one pixel where that is larger."""
    columns, rows = grid_of(width, height)
    return min(2 * columns, width), min(2 * rows, height)


def pooled(image: Float[Tensor, "H W C"], grid: tuple[int, int]) -> Float[Tensor, "C rows columns"]:
    """Mean of an image over each cell of a grid of (columns, rows), no finer than it.

    A pixel counts in each cell by the part of it that lies there; a GPU takes samples between the
    pixels, at least one for each, which on a photo is off by 2e-3 (RMSE). Without gradients.
    """
    image, (columns, rows) = image.detach(), grid
    if not image.is_cpu:
        down, along = math.ceil(image.shape[0] / rows), math.ceil(image.shape[1] / columns)
        size = rows * down, columns * along
        samples = F.interpolate(image.movedim(-1, 0)[None], size=size, mode="bilinear")
        return F.avg_pool2d(samples, (down, along))[0]
    cells = cv2.resize(image.contiguous().numpy(), grid, interpolation=cv2.INTER_AREA)
    return torch.from_numpy(cells.reshape(rows, columns, -1)).permute(2, 0, 1).contiguous()


def region_pixels(
    regions: Shaped[Tensor, "rows columns"], height: int, width: int
) -> Shaped[Tensor, "H W 1"]:
    """The pixels whose cell is in a region, by numbers or by True as the cells have it."""
    for dim, pixels in ((1, width), (0, height)):
        cells = _cells_of_pixels(regions.shape[dim], pixels, regions.device)
        regions = regions.index_select(dim, cells)
    return regions[..., None]


@lru_cache(maxsize=4096)  # a size of photos needs two, of a few kB each
def _cells_of_pixels(cells: int, pixels: int, device: torch.device) -> Int[Tensor, " pixels"]:
    numbers = torch.arange(cells, dtype=torch.float32, device=device)
    return F.interpolate(numbers[None, None], size=pixels)[0, 0].int()


def window_means(
    cells: Float[Tensor, "C rows columns"], size: int
) -> Float[Tensor, "C rows columns"]:
    """Means over windows of `size` x `size` cells (an odd number), as far as they are in the image.
    Without gradients.
    """
    cells = cells.detach()
    if not cells.is_cpu:
        return F.avg_pool2d(cells[None], size, 1, size // 2, count_include_pad=False)[0]
    sums = _window_sums(cells.permute(1, 2, 0).contiguous().numpy(), size)
    means = sums.reshape(*cells.shape[1:], -1) / _window_counts(*cells.shape[1:], size)
    return torch.from_numpy(means).permute(2, 0, 1)


@lru_cache(maxsize=32)
def _window_counts(rows: int, columns: int, size: int) -> Float[np.ndarray, "rows columns 1"]:
    """Cells in each window."""
    return _window_sums(np.ones((rows, columns), np.float32), size)[..., None]


def _window_sums(planes: Float[np.ndarray, "rows columns *C"], size: int) -> np.ndarray:
    window = (size, size)
    return cv2.boxFilter(planes, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)
