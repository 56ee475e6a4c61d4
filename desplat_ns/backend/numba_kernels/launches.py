"""The kernels that Python launches, each with arguments of the types that it is launched with.

A kernel that is added goes into `launches` as well; a test holds that none is missing and that no
step launches one with other types.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np

from desplat_ns.backend.numba_kernels import (
    binning,
    detail_cells,
    expected_cells,
    outline_cells,
    over,
    passes,
    projection,
    residual_cells,
    sh,
    ssim,
)
from desplat_ns.backend.numba_kernels.pixels import Limits
from desplat_ns.backend.numba_kernels.windows import Grid


class Launch(NamedTuple):
    """A kernel and what it is called with."""

    kernel: Any
    arguments: list[Any]

    @property
    def types(self) -> tuple[Any, ...]:
        """Of its arguments, as numba knows them."""
        return tuple(map(numba.typeof, self.arguments))

    @property
    def module(self) -> str:
        """Name of the module that it is in."""
        return self.kernel.py_func.__module__


@cache
def launches() -> tuple[Launch, ...]:
    """All of them, those of a module in the order in which a step launches them. The modules that
    take longest to compile come first, so that the processes that compile them end together."""
    floats, ints, counts = (np.empty(0, kind) for kind in (np.float32, np.int32, np.int64))
    table, sums, terms = (np.empty((0, 0), kind) for kind in (np.int32, np.float64, np.int64))
    places, keys, spans = (np.empty(0, kind) for kind in (np.uint32, np.uint64, np.uint8))
    wanted, number, cutoff, scale = np.empty((0, 0), np.uint8), 1, 1.0, np.float32(1)
    turn = (counts, number)  # the shared counter, and how many workers there are
    gaussians = binning.Gaussians(floats, floats, floats, floats, floats, number)
    lists = binning.Lists(ints, floats, ints, ints, ints, ints, spans)
    grid, frame, limits = (
        binning.Grid(*[number] * 4),
        passes.Frame(*[floats] * 5),
        Limits(scale, scale, scale),
    )
    four, size, sizes = (floats,) * 4, (number,) * 2, (number,) * 3
    records = (floats, number, cutoff, grid, ints)
    colors = (floats, floats, ints, floats, terms, floats, sizes)
    drawn = (number, limits)
    both, flags, weights = (floats,) * 2, np.empty(0, np.bool_), np.empty((0, 0), np.float32)
    cells, three, pair = Grid(keys, weights, keys, weights), (floats,) * 3, (scale,) * 2
    memory, doubles = (*three, sums), np.empty(0)
    rules, edges = (scale,) * 5, (number, cutoff)
    found = (
        (passes.draw_frame, lists, number, grid, frame, *drawn, *turn),
        (passes.backward_frame, lists, number, grid, frame, frame, *drawn, floats, *turn),
        (passes.sum_rows, lists, floats, number, floats, *turn),
        (projection._project, four, four, ints, floats, *turn),
        (projection._backward, four, four, four, ints, floats, *turn),
        (ssim.score_image, three, size, wanted, (scale,) * 3, (sums, sums), floats, *turn),
        (over.put_over, *four, *turn),
        (over.pull_under, *four, floats, *turn),
        (over.pull_within, *four[:3], *turn),
        (detail_cells.judge_cells, both, size, floats, cells, size, rules, spans, doubles, number),
        (outline_cells.outline, doubles, doubles, size, *edges, size, flags, number),
        (residual_cells.compare_images, both, cells, cells, number, scale, both, floats, number),
        (
            *(
                expected_cells.remember,
                floats,
                flags,
                pair,
                three,
                (scale,) * 4,
                floats,
                flags,
                number,
            ),
            *(size, memory, ints, floats, *turn),
        ),
        (binning._visible_keys, gaussians, places, ints, cutoff, keys),
        (binning._sorted, keys, keys),
        (binning._measure, gaussians, ints, *records, *turn),
        (binning._running_sum, ints),
        (binning._count, *records, ints, table, ints, floats, *turn),
        (binning._sum_up, table, ints),
        (binning._fill, lists, grid, ints, ints, floats, table, *turn),
        (binning._write_spans, lists, grid, floats, *turn),
        (sh._evaluate, *colors, floats, *turn),
        (sh._backward, *colors, *four, *turn),
    )
    return tuple(Launch(kernel, arguments) for kernel, *arguments in found)
