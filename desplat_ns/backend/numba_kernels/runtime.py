"""How kernels are compiled and launched: the cache, threads, and three instructions numba lacks.

- Compiled kernels are kept in a folder of their own for each state of their sources, numba, Python
  and processor (`FOLDER`), so that a kernel whose callee changed is never loaded. Two other
  processes compile them, each in one order, before the first launch; all that work load them.
- A kernel loops over its workers with `prange`; each takes its next piece of work from a shared
  counter (`pieces`), which balances the load where tiles, or cores, are unequal. Which worker does
  a piece never changes its result, so the same bits come out for any number of threads.
"""

import ctypes
import hashlib
import importlib.util
import inspect
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch
from filelock import FileLock
from llvmlite import ir
from numba import types
from numba.core import config as _numba_config
from numba.core.registry import cpu_target
from numba.extending import intrinsic
from torch import Tensor

numba_config: Any = _numba_config  # its settings are defined at run time, out of sight of checkers

_LAUNCH_LOCK = threading.Lock()
"""numba's "workqueue" threads abort the process when two Python threads launch kernels at once, and
nerfstudio's viewer renders from a thread of its own."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""mallopt(3): bytes at the heap's end above which they are given back; bytes from which a block is
mapped by itself, to be given back when it is freed."""

COMPILE = "import gc; gc.disable(); from desplat_ns.backend import numba_tiles as n; n.compile_{}()"
"""What the two processes that compile run, without gc a tenth faster."""

compiles_here = False
"""Whether this process is one that compiles."""


def _key() -> str:
    """What compiled kernels depend on: all sources of the backends, which have constants of theirs.
    (numba keeps a kernel for as long as its own file stays the same: before 0.68 the time of its
    last change.)
    """
    context: Any = cpu_target.target_context
    processor = context.codegen().magic_tuple()
    state = hashlib.sha256(f"{numba.__version__} {sys.version} {processor}".encode())
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        state.update(f"{path.name} {path.stat().st_mtime_ns}".encode() + path.read_bytes())
    return state.hexdigest()[:16]


def _folder() -> Path | None:
    """Where compiled kernels are kept: in NUMBA_CACHE_DIR if it is set, else beside the sources,
    else in the user's cache; None where nothing can be written."""
    user = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    roots = [Path(__file__).parent / "__pycache__", Path(user, "desplat_ns")]
    if numba_config.CACHE_DIR:
        roots = [Path(numba_config.CACHE_DIR)]
    for folder in (root / f"kernels-{_key()}" for root in roots):
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    return None


FOLDER = _folder()
"""Of the compiled kernels."""


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


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` of a function that Python launches; it is kept in `FOLDER`."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = part(**options)(function)
        if FOLDER is not None:
            before, numba_config.CACHE_DIR = numba_config.CACHE_DIR, str(FOLDER)
            dispatcher.enable_caching()
            numba_config.CACHE_DIR = before
        return dispatcher

    return decorate


def part(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` of a function that kernels call."""

    def decorate(function: Callable[..., Any]) -> Any:
        # Run-time type checkers wrap every function of the package; numba needs the bare one.
        function = inspect.unwrap(function)
        common: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
        return numba.njit(**common, **options)(function)

    return decorate


def launch(kernel: Callable[..., None], *arguments: Any) -> None:
    """Call a kernel, whose last arguments are a counter for `pieces` and the number of workers."""
    with _LAUNCH_LOCK:
        prepare()
        kernel(*arguments, np.zeros(1, np.int64), numba.get_num_threads())


@cache
def prepare() -> None:
    """Before the first launch of a process all kernels are compiled."""
    _keep_freed_memory()
    if not compiles_here:
        have_compiled()


def have_compiled() -> None:
    """Have all kernels compiled into `FOLDER`, unless they are there. It takes half a minute.

    Other processes do it: one that compiled kernels would go on with others than those it keeps.
    Of the loop that `prange` splits off it takes the copy from before the last optimization, which
    is slower and rounds differently.
    """
    try:
        if FOLDER is None:
            raise OSError("no folder can be written; NUMBA_CACHE_DIR names another")
        if not (FOLDER / "complete").exists():
            with FileLock(FOLDER / "lock"):
                if not (FOLDER / "complete").exists():
                    _compile_into(FOLDER)
    except (OSError, NotImplementedError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or str(error)
        _say(
            "The numba kernels are compiled in this process, which takes a minute in each, and may "
            f"round differently: {why.strip().splitlines()[-1]}"
        )


def _compile_into(folder: Path) -> None:
    """Have other processes compile into a folder what is kept when it is complete."""
    _say("Compiling the numba kernels for this CPU, once: about half a minute.")
    for path in folder.rglob("*.nb?"):  # of a process that was ended
        path.unlink()
    places = os.pathsep.join(map(os.path.abspath, sys.path))  # "" is the folder at hand
    run = partial(
        subprocess.run,
        env={**os.environ, "PYTHONPATH": places, "PYTHONSAFEPATH": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
    )
    with ThreadPoolExecutor() as pool:
        parts = ("drawing", "colors")
        list(pool.map(run, [(sys.executable, "-c", COMPILE.format(part)) for part in parts]))
    (folder / "complete").touch()


def _say(line: str) -> None:
    with suppress(OSError):  # a log on a full disk is no reason to stop
        print(line, file=sys.stderr, flush=True)


def empty(*shape: int) -> Tensor:
    """A tensor in the kernels' float32, whatever torch's default dtype is."""
    return torch.empty(shape, dtype=torch.float32)


def flat(tensor: Tensor) -> np.ndarray:
    """The values as a flat, contiguous array; a copy only where it takes one."""
    return tensor.detach().contiguous().view(-1).numpy()


def _instruction(function: Callable[..., Any]) -> Any:
    return intrinsic(inspect.unwrap(function))


@_instruction
def fma(typingctx, a, b, c):
    """a * b + c, rounded once. Spelled out so that forward and backward round alike."""

    def codegen(context, builder, signature, args):
        return builder.fma(*args)

    return types.float32(types.float32, types.float32, types.float32), codegen


@_instruction
def take(typingctx, counter):
    """Add one to `counter[0]` (int64) atomically and return what it held before."""

    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        return builder.atomic_rmw("add", array.data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(types.Array(types.int64, 1, "C")), codegen


@part()
def pieces(counter, number):
    """Those of so many pieces of work that this worker gets."""
    piece = take(counter)
    while piece < number:
        yield piece
        piece = take(counter)


@part()
def batches(counter, number, size):
    """First and end of the batches, each of `size`, that this worker gets of so many rows."""
    for piece in pieces(counter, (number + size - 1) // size):
        yield piece * size, min((piece + 1) * size, number)


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
