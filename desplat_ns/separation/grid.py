"""The grid of cells on which residuals and regions are computed, whatever the size of a photo.

On a CPU OpenCV takes the means, on a GPU torch does.
"""

import math
from functools import lru_cache

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Shaped
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
    """Mean of an image over each cell of a grid of (columns, rows), no finer than the image.

    A pixel counts in each cell by the part of it that lies there. Without gradients.
    """
    image, (columns, rows) = image.detach(), grid
    if not image.is_cpu:
        down = _shares(image.shape[0], rows, image.dtype, image.device)
        along = _shares(image.shape[1], columns, image.dtype, image.device)
        return torch.einsum("rh,hwc,kw->crk", down, image, along)
    cells = cv2.resize(image.contiguous().numpy(), grid, interpolation=cv2.INTER_AREA)
    return torch.from_numpy(cells.reshape(rows, columns, -1)).permute(2, 0, 1).contiguous()


@lru_cache(maxsize=256)  # a size of photos needs ten
def _shares(
    pixels: int, cells: int, dtype: torch.dtype, device: torch.device
) -> Float[Tensor, "cells pixels"]:
    """Weight of each pixel of a line in the mean of each cell; made on the device, so that nothing
    is copied there where photos have many sizes."""
    like = {"dtype": torch.float64, "device": device}
    ends = torch.arange(cells + 1, **like) * (pixels / cells)
    first = torch.arange(pixels, **like)
    least = torch.maximum(ends[:-1, None], first)
    most = torch.minimum(ends[1:, None], first + 1)
    return ((most - least).clamp(min=0) * (cells / pixels)).to(dtype)


def region_pixels(
    regions: Shaped[Tensor, "rows columns"], height: int, width: int
) -> Shaped[Tensor, "H W 1"]:
    """The pixels whose cell is in a region, by numbers or by True as the cells have it."""
    if regions.is_cpu:  # a fifth of the time
        for dim, pixels in ((1, width), (0, height)):
            cells = torch.arange(regions.shape[dim], dtype=torch.float32)[None, None]
            regions = regions.index_select(dim, F.interpolate(cells, size=pixels)[0, 0].int())
        return regions[..., None]
    cells = regions[None, None].to(torch.float32)
    return F.interpolate(cells, size=(height, width))[0, 0, :, :, None].to(regions.dtype)


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
