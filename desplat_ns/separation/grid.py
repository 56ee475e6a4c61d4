"""The grid of cells on which residuals and regions are computed, whatever the size of a photo.

Regions are found on the host. A copy to it waits until a GPU has done all that it was given, so a
step has as few of them as can be.
"""

from __future__ import annotations

import math

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
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


def counted_cells(mask: Bool[Tensor, "H W 1"]) -> Bool[Tensor, "rows columns"]:
    """The cells of `grid_of` of which half counts; `mask` is True in the pixels that count."""
    height, width = mask.shape[:2]
    return pooled(mask.to(torch.float32), grid_of(width, height))[0] >= 0.5


def region_pixels(
    regions: Bool[Tensor, "rows columns"], height: int, width: int
) -> Bool[Tensor, "H W 1"]:
    """The pixels whose cell is in a region."""
    cells = regions[None, None].to(torch.float32)
    return F.interpolate(cells, size=(height, width))[0, 0, :, :, None] > 0


def window_means(
    cells: Float[Tensor, "C rows columns"], size: int
) -> Float[Tensor, "C rows columns"]:
    """Means over windows of `size` x `size` cells (an odd number), as far as they are in the image.

    From running sums along columns and rows, so that a wide window takes no longer than a narrow
    one. They are as exact as the sum of a whole column: for values of like size, such as colours.
    """
    counts = torch.ones_like(cells[:1])
    return _window_sums(cells, size) / _window_sums(counts, size)


def _window_sums(cells: Tensor, size: int) -> Tensor:
    return _sums_along(_sums_along(cells, size, 2), size, 1)


def _sums_along(cells: Tensor, size: int, dim: int) -> Tensor:
    count, half = cells.shape[dim], size // 2
    running = F.pad(cells, [0, 0] * (2 - dim) + [half + 1, half]).cumsum(dim)
    return running.narrow(dim, size, count) - running.narrow(dim, 0, count)


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
