"""Have kernels that the cache lacks compiled: by several processes, with a line of progress.

A process that compiled kernels would go on with others than those it puts into the cache: of the
loop that `prange` splits off it takes the copy from before the last optimization, which is slower
and rounds differently. So other processes compile them, and every process that works loads them.

What a kernel becomes may also depend on what the same process has compiled before: a product of
three numbers is taken in another order. So there is a new process for each module, which compiles
all kernels of it in their order; as many as there are cores at once. On Linux they are forked,
which saves them the seconds that importing torch takes; elsewhere, where forking is not safe, they
are started anew.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol, runtime_checkable

from filelock import FileLock, Timeout

from desplat_ns.backend.numba_kernels.launches import Launch, launches
from desplat_ns.backend.numba_kernels.runtime import (
    before_first_launch,
    kernels,
    numba_config,
)
from desplat_ns.cores import cores

PATIENCE = 300.0
"""Seconds without a kernel done after which other processes are given up; one takes six."""

PAUSE, LINE_EVERY = 0.1, 4.0
"""Seconds between two looks at the cache, and between two lines in a log."""


def have_compiled() -> None:
    """Have other processes put the missing kernels into the cache; this one loads them from there.

    Where that fails, or where nothing can be cached, they are compiled here as they are called.
    """
    missing = missing_kernels()
    if not missing:
        return
    progress = Progress(len(missing))
    folders = {launch.kernel.stats.cache_path for launch in launches()}
    if None not in folders:
        with suppress(OSError), ExitStack() as stack:
            _wait_for_others(stack, Path(min(folders)), progress)
            _compile([launch.module for launch in missing_kernels()], progress)
    progress.end()


def is_cached(launch: Launch) -> bool:
    """Whether the cache has a kernel for this processor. Machines may share a folder; a copy that
    another processor left is of no use here. (numba 0.60 to 0.68: its index is private.)"""
    if not launch.kernel.stats.cache_path:
        return False
    processor = launch.kernel.targetctx.codegen().magic_tuple()
    index = launch.kernel._cache._cache_file._load_index()
    return any(key[:2] == (launch.types, processor) for key in index)


def missing_kernels() -> list[Launch]:
    """Those that are still to be compiled."""
    return [launch for launch in launches() if not is_cached(launch)]


class Progress:
    """The line of progress: written over on a terminal, a new one now and then in a log."""

    def __init__(self, total: int) -> None:
        self._total, self._began = total, time.monotonic()
        self._on_terminal, self._next = sys.stderr.isatty(), 0.0
        self.say()

    def say(self) -> None:
        """Where it is time for that: how many kernels are there, and the seconds so far."""
        seconds = time.monotonic() - self._began
        if seconds >= self._next:
            self._next = seconds + (0.5 if self._on_terminal else LINE_EVERY)
            self._print("" if self._on_terminal else "\n")

    def end(self) -> None:
        """The last line."""
        self._print("\n")

    def _print(self, end: str) -> None:
        done, seconds = self._total - len(missing_kernels()), time.monotonic() - self._began
        line = f"Compiling the numba kernels for this CPU, once: {done} of {self._total}"
        start = "\r" if self._on_terminal else ""
        with suppress(OSError):  # a log on a full disk is no reason to stop
            print(f"{start}{line}, {seconds:.0f} s", end=end, file=sys.stderr, flush=True)


def _wait_for_others(stack: ExitStack, folder: Path, progress: Progress) -> None:
    """Until no other process compiles into the folder, or nothing is missing any more. Where a
    folder cannot be locked, nobody is waited for."""
    with suppress(OSError, NotImplementedError):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".compiling.lock", timeout=0)
        while missing_kernels():
            with suppress(Timeout):
                stack.enter_context(lock)
                return
            progress.say()
            time.sleep(PAUSE)


@runtime_checkable
class Worker(Protocol):
    """A process, as `subprocess.Popen` has it."""

    def poll(self) -> int | None: ...

    def kill(self) -> None: ...


def _compile(modules: Sequence[str], progress: Progress) -> None:
    """Have each module compiled and wait for the end; what is left undone then is compiled as it
    is called."""
    waiting, working = list(dict.fromkeys(modules)), list[Worker]()
    left, since = len(launches()) + 1, time.monotonic()
    try:
        while waiting or working:
            while waiting and len(working) < cores():
                working.append(_start(waiting.pop(0)))
            time.sleep(PAUSE)
            working = [worker for worker in working if worker.poll() is None]
            progress.say()
            now = len(missing_kernels())
            left, since = (now, time.monotonic()) if now < left else (left, since)
            if time.monotonic() > since + PATIENCE:
                return
    finally:
        for worker in working:
            worker.kill()


def _start(module: str) -> Worker:
    """A process that compiles a module."""
    if sys.platform == "linux":
        return Forked(module)
    places = os.pathsep.join(map(os.path.abspath, sys.path))  # "" is the folder at hand
    return subprocess.Popen(
        [sys.executable, "-m", __name__, module],
        env={**os.environ, "PYTHONPATH": places, "PYTHONSAFEPATH": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


class Forked:
    """A copy of this process that compiles a module, silently, and ends."""

    def __init__(self, module: str) -> None:
        self._status: int | None = None
        self._pid = os.fork()
        if self._pid:
            return
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_DFL)
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nothing, stream)
            compile_module(module)
        finally:
            os._exit(0)

    def poll(self) -> int | None:
        """Its exit status; None while it works."""
        if self._status is None:
            try:
                pid, status = os.waitpid(self._pid, os.WNOHANG)
            except ChildProcessError:  # somebody else has waited for it
                pid, status = self._pid, 0
            self._status = status if pid else None
        return self._status

    def kill(self) -> None:
        """End it at once."""
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)


def compile_module(module: str) -> None:
    """Compile all kernels of a module anew, in their order, into the cache."""
    gc.disable()  # a tenth faster, for a process that ends soon
    numba_config.THREADING_LAYER = "workqueue"  # GNU's OpenMP must not start in a forked process
    chosen = [launch for launch in launches() if launch.module == module]
    for part in {*kernels}.difference(launch.kernel for launch in launches()):
        part.targetoptions["no_cpython_wrapper"] = True  # it is called by kernels only here
        part._cache.disable()
    for kernel, types in ((launch.kernel, launch.types) for launch in chosen):
        # The first may be there. What refreshing does later, changes what a kernel becomes.
        kernel._cache.load_overload = lambda _, context: context.refresh()
        kernel.compile(types)


if __name__ == "__main__":
    compile_module(sys.argv[1])
else:
    before_first_launch.append(have_compiled)
