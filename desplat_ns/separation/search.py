"""The search for regions as a training step takes it: compiled on a CPU, where OpenCV and torch
take a fifth of a step for it, and elsewhere by the statements of `regions`, its reference."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.separation import regions as statement
from desplat_ns.separation import residuals
from desplat_ns.separation.grid import fine_grid_of, grid_of, line_shares
from desplat_ns.separation.regions import Comparison, StaticView
from desplat_ns.separation.residuals import Excess, ResidualStats


@cache
def _kernels() -> dict[str, Any] | None:
    """The compiled kernels by name, imported by the first search: numba is large. None where it is
    missing."""
    try:
        from desplat_ns.backend.numba_kernels.detail_cells import judge_cells
        from desplat_ns.backend.numba_kernels.expected_cells import remember
        from desplat_ns.backend.numba_kernels.outline_cells import outline
        from desplat_ns.backend.numba_kernels.residual_cells import compare_images
    except ImportError:
        return None
    return {kernel.__name__: kernel for kernel in (compare_images, remember, judge_cells, outline)}


def _are_compiled_for(*tensors: Tensor) -> bool:
    is_cpu = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in tensors)
    return is_cpu and _kernels() is not None


def _launch(kernel: str, *arguments: Any) -> None:
    """Tensors are handed over as flat arrays; those that are written into are contiguous."""
    from desplat_ns.backend.numba_kernels.runtime import flat, launching, num_workers

    def as_array(value: Any) -> Any:
        if type(value) is tuple:
            return tuple(map(as_array, value))
        return flat(value) if isinstance(value, Tensor) else value

    kernels = _kernels()
    assert kernels is not None
    with launching():
        kernels[kernel](*map(as_array, arguments), num_workers())


def compare(
    photo: Float[Tensor, "H W 3"],
    static: StaticView,
    stats: ResidualStats,
    counted: Bool[Tensor, "rows columns"] | None = None,
) -> tuple[Comparison, ResidualStats]:
    """See `regions.compare`."""
    if not _are_compiled_for(photo, static.rgb, static.means2d, static.opacities, stats.usual):
        return statement.compare(photo, static, stats, counted)
    size = photo.shape[1], photo.shape[0]
    (columns, rows), (fine_columns, fine_rows) = grid_of(*size), fine_grid_of(*size)
    colors, residual = torch.empty(2, 3, fine_rows, fine_columns), torch.empty(rows, columns)
    grids = _grid(*size, fine_columns, fine_rows), _grid(fine_columns, fine_rows, columns, rows)
    rule = residuals.SMOOTHING // 2, np.float32(residuals.MIN_RESIDUAL)
    _launch("compare_images", (static.rgb, photo), *grids, *rule, (colors[0], colors[1]), residual)
    excess, stats = _excess(residual, size, static, stats, counted)
    return Comparison(colors[0], colors[1], excess, counted), stats


def _excess(
    residual: Float[Tensor, "rows columns"],
    size: tuple[int, int],
    static: StaticView,
    stats: ResidualStats,
    counted: Bool[Tensor, "rows columns"] | None,
) -> tuple[Excess, ResidualStats]:
    """See `residuals.excess_residual`; `size` is that of the photo, width and height."""
    from desplat_ns.backend.numba_kernels.expected_cells import GAUSSIANS

    (rows, columns), visits, number = residual.shape, stats.visits + 1, len(stats.usual)
    level, expected = _level(residual, counted), torch.empty(rows, columns)
    usual, times_seen, weights = (torch.empty(number) for _ in range(3))
    totals = np.empty((-(-number // GAUSSIANS), 2))
    rule = (stats.num_views / visits, residuals.LEAST_VIEWS)
    rule += (residuals.MEDIAN_STEP, residuals.TYPICAL_WEIGHT)
    _launch(
        "remember",
        *(static.means2d, static.visible, _floats(columns / size[0], rows / size[1])),
        *((static.opacities, stats.usual, stats.times_seen), _floats(*rule)),
        F.pad((residual / level).log().flatten(), (0, 1)),
        torch.empty(0, dtype=torch.bool) if counted is None else counted,
        *(residuals.EXPECTED_WINDOW // 2, (rows, columns)),
        *((usual, times_seen, weights, totals), np.empty(number, np.int32), expected),
        np.zeros(1, np.int64),
    )
    values = residual - level * expected.exp()
    values = values if counted is None else values.masked_fill(~counted, 0.0)
    stats = replace(stats, usual=usual, times_seen=times_seen, visits=visits)
    return Excess(values, level), stats


def _level(
    residual: Float[Tensor, "rows columns"], counted: Bool[Tensor, "rows columns"] | None
) -> Float[Tensor, ""]:
    """See `residuals._level`; nothing is sorted but around the two values that it lies between."""
    values = residual.flatten() if counted is None else residual[counted]
    if len(values) == 0:
        return torch.tensor(residuals.MIN_RESIDUAL)
    place = residuals.LEVEL_QUANTILE * (len(values) - 1)
    ends = math.floor(place), math.ceil(place)
    below, above = torch.from_numpy(np.partition(values.numpy(), ends)[list(ends)])
    return below.lerp(above, place - ends[0])


def find_regions(comparison: Comparison, config: DistractorConfig) -> Bool[Tensor, "rows columns"]:
    """See `regions.find_regions`."""
    excess, counted, photo = comparison.excess, comparison.counted, comparison.photo
    if not _are_compiled_for(comparison.static, photo, excess.values):
        return statement.find_regions(comparison, config)
    (rows, columns), most = excess.values.shape, config.strong_excess
    kinds, colors = np.empty(rows * columns, np.uint8), np.empty(3 * rows * columns)
    strong = excess.needed(config.strong_levels, config.settled_share * most, most).item()
    rules = (config.weak_excess, strong, config.shared_detail)
    _launch(
        "judge_cells",
        *((comparison.static, photo), tuple(photo.shape[1:]), excess.values),
        _grid(photo.shape[2], photo.shape[1], columns, rows),
        (residuals.SMOOTHING // 2, statement.DETAIL_WINDOW // 2),
        _floats(*rules, statement.DETAIL_NOISE, statement.MOST_CONTRAST),
        *(kinds, colors),
    )
    kinds, regions = kinds.reshape(rows, columns), torch.zeros(rows, columns, dtype=torch.bool)
    inside = statement.connected(kinds > 0, kinds == 2)
    filled = inside.any(axis=1).nonzero()[0]
    if len(filled) == 0:
        return regions
    _launch(
        "outline",
        *(colors, inside.ravel().astype(np.float64), (rows, columns)),
        *(statement.OUTLINE_WINDOW // 2, statement.OUTLINE_NOISE),
        *((int(filled[0]), int(filled[-1]) + 1), regions),
    )
    return regions if counted is None else regions & counted


def _floats(*numbers: float | int) -> tuple[np.float32, ...]:
    return tuple(map(np.float32, numbers))


@lru_cache(maxsize=32)
def _grid(width: int, height: int, columns: int, rows: int) -> Any:
    """Which parts of an image cells are, as the kernels have it."""
    from desplat_ns.backend.numba_kernels.windows import Grid

    return Grid(*_parts(height, rows), *_parts(width, columns))


def _parts(pixels: int, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """The first pixel of each cell, and weights of it and of those that follow."""
    shares = line_shares(pixels, cells).numpy()
    most = (shares > 0).sum(axis=1).max()
    first = np.minimum((shares > 0).argmax(axis=1), pixels - most)
    weights = np.take_along_axis(shares, first[:, None] + np.arange(most), axis=1)
    return first.astype(np.uint64), np.ascontiguousarray(weights.T, np.float32)
