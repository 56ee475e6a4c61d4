"""The kernels that Python launches, each with arguments of the types that it is launched with.

A kernel that is added goes into `launches` as well; a test holds that none is missing and that no
step launches one with other types.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np

from desplat_ns.backend.numba_kernels import (
    binning,
    over,
    passes,
    projection,
    sh,
    ssim,
)
from desplat_ns.backend.numba_kernels.pixels import Limits

_FLOATS, _INTS, _COUNTS = (np.empty(0, kind) for kind in (np.float32, np.int32, np.int64))
_KEYS, _PLACES, _BYTES = (np.empty(0, kind) for kind in (np.uint64, np.uint32, np.uint8))
_NUMBER, _CUTOFF, _SCALE = 1, 1.0, np.float32(1)
_TURN = (_COUNTS, _NUMBER)
"""The shared counter, and how many workers there are."""
_SIZE = (_NUMBER,) * 2
_THREE, _FOUR = ((_FLOATS,) * count for count in (3, 4))


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
    rows = (*_of_drawing(), *_of_images(), *_of_lists(), *_of_harmonics())
    return tuple(Launch(kernel, arguments) for kernel, *arguments in rows)


def _table(kind: Any) -> np.ndarray:
    return np.empty((0, 0), kind)


def _lists() -> binning.Lists:
    return binning.Lists(_INTS, _FLOATS, _INTS, _INTS, _INTS, _INTS, _BYTES)


def _grid() -> binning.Grid:
    return binning.Grid(*[_NUMBER] * 4)


def _of_drawing() -> Iterator[tuple[Any, ...]]:
    lists, grid, frame = _lists(), _grid(), passes.Frame(*[_FLOATS] * 5)
    drawn = (_NUMBER, Limits(_SCALE, _SCALE, _SCALE))
    yield (passes.draw_frame, lists, _NUMBER, grid, frame, *drawn, *_TURN)
    yield (passes.backward_frame, lists, _NUMBER, grid, frame, frame, *drawn, _FLOATS, *_TURN)
    yield (passes.sum_rows, lists, _FLOATS, _NUMBER, _FLOATS, *_TURN)
    yield (projection._project, _FOUR, _FOUR, _INTS, _FLOATS, *_TURN)
    yield (projection._backward, _FOUR, _FOUR, _FOUR, _INTS, _FLOATS, *_TURN)


def _of_images() -> Iterator[tuple[Any, ...]]:
    rates, sums = (_SCALE,) * 3, (_table(np.float64),) * 2
    yield (ssim.score_image, _THREE, _SIZE, _table(np.uint8), rates, sums, _FLOATS, *_TURN)
    yield (over.put_over, *_FOUR, True, *_TURN)
    yield (over.pull_under, *_FOUR, *_THREE, *_TURN)
    yield (over.pull_within, *_THREE, *_TURN)


def _of_lists() -> Iterator[tuple[Any, ...]]:
    lists, grid, table = _lists(), _grid(), _table(np.int32)
    gaussians = binning.Gaussians(_FLOATS, _FLOATS, _FLOATS, _FLOATS, _FLOATS, _NUMBER)
    records = (_FLOATS, _NUMBER, _CUTOFF, grid, _INTS)
    yield (binning._visible_keys, gaussians, _PLACES, _INTS, _CUTOFF, _KEYS)
    yield (binning._sorted, _KEYS, _KEYS)
    yield (binning._measure, gaussians, _INTS, *records, *_TURN)
    yield (binning._running_sum, _INTS)
    yield (binning._count, *records, _INTS, table, _INTS, _FLOATS, *_TURN)
    yield (binning._sum_up, table, _INTS)
    yield (binning._fill, lists, grid, _INTS, _INTS, _FLOATS, table, *_TURN)
    yield (binning._write_spans, lists, grid, _FLOATS, *_TURN)


def _of_harmonics() -> Iterator[tuple[Any, ...]]:
    sizes, terms = (_NUMBER,) * 3, _table(np.int64)
    colors = (_FLOATS, _FLOATS, _INTS, _FLOATS, terms, _FLOATS, sizes)
    yield (sh._evaluate, *colors, _FLOATS, *_TURN)
    yield (sh._backward, *colors, *_FOUR, *_TURN)
