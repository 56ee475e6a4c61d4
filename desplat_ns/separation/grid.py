"""The grid of cells on which residuals and regions are computed, whatever the size of a photo.

On a CPU OpenCV takes the means, on a GPU torch does. Regions are found on the host: the copy to it
waits until a GPU has done all that it was given, so a step has one.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Shaped
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


def counted_cells(mask: Bool[Tensor, "H W 1"]) -> Bool[Tensor, "rows columns"]:
    """The cells of `grid_of` of which half counts; `mask` is True in the pixels that count."""
    height, width = mask.shape[:2]
    return pooled(mask.to(torch.float32), grid_of(width, height))[0] >= 0.5


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


def window_maxima(plane: Float[Tensor, "H W"], size: int) -> Float[Tensor, "H W"]:
    """Maxima over windows of `size` x `size` pixels (an odd number). Without gradients."""
    plane = plane.detach()
    if not plane.is_cpu:
        rows = F.max_pool1d(plane, size, 1, size // 2)  # row by row: a tenth of max_pool2d's time
        return F.max_pool1d(rows.T.contiguous(), size, 1, size // 2).T
    return torch.from_numpy(cv2.dilate(plane.numpy(), np.ones((size, size), np.uint8)))


@lru_cache(maxsize=32)
def _window_counts(rows: int, columns: int, size: int) -> Float[np.ndarray, "rows columns 1"]:
    """Cells in each window."""
    return _window_sums(np.ones((rows, columns), np.float32), size)[..., None]


def _window_sums(planes: Float[np.ndarray, "rows columns *C"], size: int) -> np.ndarray:
    window = (size, size)
    return cv2.boxFilter(planes, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)


def masks_to_host(*masks: Bool[Tensor, "..."]) -> list[Bool[np.ndarray, "..."]]:
    """Copies of masks of any shapes on the host, which waits once."""
    flat = torch.cat([mask.flatten() for mask in masks]).cpu().numpy()
    ends = np.cumsum([mask.numel() for mask in masks])
    parts = np.split(flat, ends[:-1])
    return [part.reshape(mask.shape) for part, mask in zip(parts, masks, strict=True)]


def to_device(values: np.ndarray, device: torch.device) -> Tensor:
    """A copy on the device. Nothing waits: a GPU fetches it from pinned memory in its turn."""
    tensor = torch.from_numpy(values)
    if device.type == "cuda":
        return tensor.pin_memory().to(device, non_blocking=True)
    return tensor.to(device)
