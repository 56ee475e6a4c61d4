"""How kernels are compiled and launched: the cache, threads, and four instructions numba lacks.

- Kernels live at module level, so that numba can cache them on disk (it cannot for closures). Where
  no cache folder can be written they are compiled anew in each process instead of failing.
- Other processes compile what the cache lacks (`compiling`), and every process that works loads it.
- Numbers that may differ between installations are arguments of the kernels, never globals: a
  cached kernel would keep the old value.
- A kernel loops over `num_workers()` workers with `prange`; each takes its next piece of work from
  a shared counter (`take`), which balances the load where tiles, or cores, are unequal. Which
  worker does a piece never changes its result, so the same bits come out for any number of threads.
"""

from __future__ import annotations

import ctypes
import importlib.util
import inspect
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import config as _numba_config
from numba.extending import intrinsic
from torch import Tensor

numba_config: Any = _numba_config  # its settings are defined at run time, out of sight of checkers

_LAUNCH_LOCK = threading.RLock()
"""numba's "workqueue" threads abort the process when two Python threads launch kernels at once, and
nerfstudio's viewer renders from a thread of its own."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""mallopt(3): bytes at the heap's end above which they are given back; bytes from which a block is
mapped by itself, to be given back when it is freed."""

_NEWEST_SOURCE = max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))

kernels: list[Any] = []
"""Every kernel: those that Python launches (`launches`) and those that are parts of them."""

before_first_launch: list[Callable[[], None]] = []
"""What is done once in each process that launches a kernel: `compiling` enters itself here."""

_is_ready = False
"""Whether this process has seen to it that its kernels are compiled."""


def _prefer_safe_threads() -> None:
    """Choose tbb, else workqueue, unless the user has chosen.

    numba would take OpenMP before workqueue; GNU OpenMP ends a process that forks after its first
    parallel region, as data loaders do, and its threads spin beside torch's.
    """
    asked = {"NUMBA_THREADING_LAYER", "NUMBA_THREADING_LAYER_PRIORITY"} & os.environ.keys()
    if not asked and importlib.util.find_spec("tbb") is None:
        numba_config.THREADING_LAYER_PRIORITY = ["workqueue", "omp", "tbb"]


_prefer_safe_threads()


def _keep_freed_memory() -> None:
    """Have glibc keep what a step frees for the next one, which asks for as much.

    It would give blocks above 32 MiB back at once, and the system map and clear them again page by
    page, one thread at a time: a tenth to a fifth of a step with 200,000 Gaussians at 1200 x 800.
    What the user has set stays, and so does another allocator.
    """
    if any(name.startswith("MALLOC_") for name in os.environ) or "GLIBC_TUNABLES" in os.environ:
        return
    with suppress(OSError, AttributeError, TypeError):  # no glibc
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP_THRESHOLD, 1 << 30)
        mallopt(_TRIM_THRESHOLD, (1 << 31) - 1)


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """`numba.njit` with the disk cache on where a cache folder can be written, else without."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        # Run-time type checkers wrap every function of the package; numba needs the bare one.
        function = inspect.unwrap(function)
        common: dict[str, Any] = {"nogil": True, "error_model": "numpy", **options}
        common["no_cfunc_wrapper"] = True  # C calls none
        try:
            dispatcher = numba.njit(cache=True, **common)(function)
            _drop_stale(dispatcher.stats.cache_path)
        except RuntimeError:  # "cannot cache function ...: no locator available"
            dispatcher = numba.njit(**common)(function)
        kernels.append(dispatcher)
        return dispatcher

    return decorate


@cache
def _drop_stale(folder: str) -> None:
    """Remove cached kernels older than any file of kernels: numba looks at a kernel's own only."""
    for index in Path(folder).glob("*.nbi"):
        with suppress(OSError):
            if index.stat().st_mtime < _NEWEST_SOURCE:
                index.unlink()


@contextmanager
def launching() -> Iterator[None]:
    """Hold the launch lock; the first launch of a process has missing kernels compiled."""
    global _is_ready
    with _LAUNCH_LOCK:
        if not _is_ready:
            _is_ready = True
            _keep_freed_memory()
            for prepare in before_first_launch:
                prepare()
        yield


def num_workers() -> int:
    """How many workers a kernel is split into: numba's current number of threads."""
    return numba.get_num_threads()


def flat(tensor: Tensor) -> np.ndarray:
    """The values as a flat, contiguous array; a copy only where it takes one."""
    return tensor.detach().contiguous().view(-1).numpy()


def new_counter() -> np.ndarray:
    """A fresh counter for `take`."""
    return np.zeros(1, np.int64)


_scratch = np.empty(0, np.float32)


def scratch(size: int) -> np.ndarray:
    """`size` float32 of any value, from one buffer that every caller gets: use them up within one
    `launching`. Fresh memory for each step would have to be mapped, page by page, each time."""
    global _scratch
    if _scratch.size < size:
        _scratch = np.empty(size + size // 4, np.float32)
    return _scratch[:size]


def _instruction(function: Callable[..., Any]) -> Any:
    return intrinsic(inspect.unwrap(function))


@_instruction
def fma(typingctx, a, b, c):
    """a * b + c, rounded once. Spelled out so that forward and backward round alike."""

    def codegen(context, builder, signature, args):
        return builder.fma(*args)

    return types.float32(types.float32, types.float32, types.float32), codegen


@_instruction
def nearest(typingctx, x):
    """The integer nearest to x, as a float32."""

    def codegen(context, builder, signature, args):
        rint = builder.module.declare_intrinsic("llvm.rint", [ir.FloatType()])
        return builder.call(rint, args)

    return types.float32(types.float32), codegen


@_instruction
def float_of_bits(typingctx, bits):
    """The float32 whose bits are the given int32."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.int32), codegen


@_instruction
def take(typingctx, counter):
    """Add one to `counter[0]` (int64) atomically and return what it held before."""

    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        return builder.atomic_rmw("add", array.data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(types.Array(types.int64, 1, "C")), codegen


@_instruction
def prefetch(typingctx, array, at):
    """Ask for the cache line of array[at] (float32), for use a little later; never faults."""

    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        place = builder.bitcast(builder.gep(array.data, [args[1]]), ir.IntType(8).as_pointer())
        number, options = ir.IntType(32), (0, 3, 1)  # to read; keep in every cache; data
        kind = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        name = "llvm.prefetch.p0"
        call = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        builder.call(call, [place, *(number(option) for option in options)])
        return context.get_dummy_value()

    return types.void(types.Array(types.float32, 1, "C"), types.int64), codegen
