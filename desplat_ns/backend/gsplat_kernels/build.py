"""Compile gsplat's kernels, once for each machine and versions, and remember it if that failed.

gsplat's own code does it, with the flags that it knows, in a process of its own that has the tools'
variables. This process stays as it is.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import psutil
import torch
from filelock import FileLock, Timeout

from desplat_ns.backend.gsplat_kernels.tools import NoKernels, Tools, find_tools
from desplat_ns.cores import cores

CPU_MINUTES = 33
"""That all files take, for one architecture; measured with nvcc 13.2 and gsplat 1.4.0."""

BYTES_A_JOB = 4 << 30
"""Of memory that one compiler may need."""

NAME = "gsplat_cuda"
"""Of the module, and of the folder in which gsplat compiles it."""

COMPILE = """
import shutil
shutil.rmtree = lambda *_, **__: None  # gsplat would throw away what an interrupted call compiled
import gsplat.cuda._backend as backend
raise SystemExit(backend._C is None)
"""

FILES = 25
"""Of gsplat 1.4.0: more jobs have nothing to do."""

CONTAINERS_MEMORY = Path("/sys/fs/cgroup/memory.max")
"""What a container may use, where this process is in one."""

LAST_LINES = 6
"""Of a compiler's complaints that an error repeats."""

AGAIN = "python -m desplat_ns.backend.compile_kernels gsplat"


@dataclass(frozen=True)
class Target:
    """What kernels are compiled for. Any difference makes others necessary."""

    architectures: str
    """Of GPUs, as TORCH_CUDA_ARCH_LIST has them: "8.9", "8.0;9.0"."""
    gsplat: str
    torch: str
    python: str

    @classmethod
    def here(cls, architectures: str) -> Target:
        """The versions of this process."""
        python = f"{sys.version_info[0]}.{sys.version_info[1]}"
        return cls(architectures, version("gsplat"), torch.__version__, python)

    @property
    def folder(self) -> Path:
        """Where they are kept: in the folder of torch's extensions, TORCH_EXTENSIONS_DIR if set."""
        root = os.environ.get("TORCH_EXTENSIONS_DIR")
        cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
        name = f"gsplat-{self.gsplat} torch-{self.torch} python-{self.python} {self.architectures}"
        return Path(root or Path(cache, "torch_extensions")) / re.sub(r"[^\w.+-]", "_", name)

    @property
    def library(self) -> Path:
        """The compiled module. It is put here when it is complete."""
        return self.folder / f"{NAME}.so"

    @property
    def failure(self) -> Path:
        """With which tools compiling failed, in the first line, and why."""
        return self.folder / "failure.txt"


def library_for(target: Target) -> Path:
    """The compiled kernels' file; compiles it if there is none.

    Raises:
        NoKernels: a tool is missing, or the compiler failed, now or before with the same tools.
    """
    if target.library.exists():
        return target.library
    tools = find_tools()
    try:
        target.folder.mkdir(parents=True, exist_ok=True)
        with _lock(target.folder):
            if not target.library.exists():  # another process may have been faster
                _compile(target, tools)
    except OSError as error:
        raise NoKernels(
            f"has no CUDA kernels here, and nothing can be written to {target.folder} ({error}). "
            "Name another folder with TORCH_EXTENSIONS_DIR."
        ) from error
    return target.library


def forget_failure(target: Target) -> None:
    """Let the next call try again, although nothing changed."""
    with suppress(OSError):
        target.failure.unlink()


def jobs() -> int:
    """How many files are compiled at once: as MAX_JOBS says, else by memory and cores."""
    asked = os.environ.get("MAX_JOBS", "")
    if asked.isdigit() and int(asked) > 0:
        return int(asked)
    memory = psutil.virtual_memory().available
    with suppress(OSError, ValueError):  # no such file, or "max"
        memory = min(memory, int(CONTAINERS_MEMORY.read_text()))
    return max(1, min(cores(), FILES, memory // BYTES_A_JOB))


def _lock(folder: Path) -> AbstractContextManager[object]:
    """Held already: no other process compiles in a folder. The lock of one that died is free."""
    lock = FileLock(folder / "lock")
    try:
        return lock.acquire(timeout=0)
    except Timeout:
        _say(f"Another process compiles gsplat's kernels (in {folder}); waiting for it.")
        return lock.acquire()


def _compile(target: Target, tools: Tools) -> None:
    """Let gsplat compile, and put the result in its place. ninja goes on from what was compiled.

    Raises:
        NoKernels: with the compiler's last lines; they are kept for the next call.
    """
    at_work, at_once, log = target.folder / NAME, jobs(), target.folder / "log.txt"
    failed_with, _, reason = _text_of(target.failure).partition("\n")
    if failed_with == tools.versions():
        raise NoKernels(
            f"{reason}\nIt is not tried again with the same tools, except by `{AGAIN}`."
        )
    _say(
        f"Compiling gsplat's CUDA kernels for compute capability {target.architectures} with nvcc "
        f"{tools.cuda}: about {max(1, round(CPU_MINUTES / at_once))} minutes, {at_once} at a time, "
        f"once for this machine and these versions. Log: {log}"
    )
    began = time.monotonic()
    code = _run(target, tools, at_once, log)
    built = at_work / f"{NAME}.so"
    if code == 0 and built.exists():
        built.replace(target.library)
        shutil.rmtree(at_work, ignore_errors=True)
        _say(f"gsplat's kernels are compiled, in {(time.monotonic() - began) / 60:.1f} minutes.")
        return
    complaints = _complaints(log)
    reason = (
        f"has no CUDA kernels here: compiling them failed ({tools.versions()}). CXX names another "
        f"C++ compiler, CUDA_HOME another nvcc. The compiler's last lines, of {log}:\n{complaints}"
    )
    if re.search("Killed|died due to", complaints):
        raise NoKernels(f"{reason}\nMAX_JOBS=1 before the command needs less memory.")
    target.failure.write_text(f"{tools.versions()}\n{reason}", "utf8")
    raise NoKernels(reason)


def _text_of(path: Path) -> str:
    return path.read_text("utf8", errors="replace") if path.exists() else ""


def _run(target: Target, tools: Tools, at_once: int, log: Path) -> int:
    """gsplat's import in another process, which compiles; its exit status."""
    variables = {
        **os.environ,
        **tools.environment(target.folder / "links"),
        "MAX_JOBS": str(at_once),
        "TORCH_EXTENSIONS_DIR": str(target.folder),
        "TORCH_CUDA_ARCH_LIST": target.architectures,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "PYTHONSAFEPATH": "1",
    }
    command = [sys.executable, "-c", COMPILE]
    with (
        log.open("w") as output,
        subprocess.Popen(
            command, env=variables, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        ) as process,
    ):
        return _wait(process, target.folder / NAME)


def _wait(process: subprocess.Popen[bytes], at_work: Path) -> int:
    """Wait for a process, and say now and then how many files are done."""
    began, said = time.monotonic(), 0
    while True:
        with suppress(subprocess.TimeoutExpired):
            return process.wait(1.0)
        done, total = _progress(at_work)
        if total and done >= said + max(1, total // 5) and done < total:
            said = done
            spent = (time.monotonic() - began) / 60
            _say(f"gsplat's kernels: {done} of {total} files after {spent:.1f} minutes.")


def _progress(at_work: Path) -> tuple[int, int]:
    """How many files are compiled, of how many; 0 of 0 before it begins."""
    with suppress(OSError):
        plan = (at_work / "build.ninja").read_text("utf8")
        total = len(re.findall(r"^build \S+\.o:", plan, flags=re.MULTILINE))
        return len(list(at_work.glob("*.o"))), total
    return 0, 0


def _complaints(log: Path) -> str:
    """What a compiler, the linker or Python complained of last, of a log that may be long."""
    lines = _text_of(log).splitlines()
    bad = re.compile(
        r"\berror\b|Error:|\bfatal\b|cannot find|undefined reference|Killed|died due to"
    )
    hints = [line.strip() for line in lines if bad.search(line)] or [line for line in lines if line]
    return "\n".join(f"    {line[:300]}" for line in hints[-LAST_LINES:])


def _say(line: str) -> None:
    """To stdout at once, although it may be a pipe."""
    print(line, flush=True)
