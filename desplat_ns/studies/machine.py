"""What the figures were measured on. Nothing that names the machine itself."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import desplat_ns
from desplat_ns.cores import cores

DIRTY = "-dirty"
"""Ends the commit where files of the package differ from it."""
SHORT = 7
"""Digits of a commit in a table."""


def code_version(package: Path | None = None) -> str:
    """The commit of the running `desplat_ns`, so that a figure can be traced to what made it.

    Args:
        package: the package's folder; by default that of the `desplat_ns` that is imported.

    Returns:
        The full hash, with `DIRTY` behind it where a file of the package was changed or added
        since; `desplat-ns` and the version where git does not track the package, for instance in
        a virtual environment, even one that lies inside a checkout.
    """
    package = package or Path(desplat_ns.__file__).parent
    try:
        _git(package, "ls-files", "--error-unmatch", "__init__.py")
        commit = _git(package, "rev-parse", "HEAD").strip()
        changed = _git(package, "status", "--porcelain", "--", ".")
    except (OSError, subprocess.CalledProcessError):
        return f"desplat-ns {desplat_ns.__version__}"
    return commit + DIRTY * bool(changed)


def short(commit: str) -> str:
    """A commit as tables give it; what is no commit stays as it is."""
    dirty = commit.endswith(DIRTY)
    digits = commit.removesuffix(DIRTY)
    is_hash = len(digits) == 40 and set(digits) <= set("0123456789abcdef")
    return (digits[:SHORT] if is_hash else digits) + ", with changes" * dirty


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


PACKAGES = ("torch", "numba", "llvmlite", "numpy", "gsplat", "pytorch-msssim")


def describe_machine() -> dict[str, str]:
    """Processor, caches, memory, system, versions, commit and date, each as a text to print."""
    return {
        "Processor": _processor(),
        "Cores used": f"1, and {cores()}",
        "Caches": _caches() or "unknown",
        "Memory": _memory() or "unknown",
        "System": f"{platform.system()} {platform.machine()}, {_distribution()}",
        "Load before the run": _load(),
        "Python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "Commit": short(code_version()),
        "Date": datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
    }


def device_name(device: str) -> str:
    """Of the GPU, or of the processor for `cpu`.

    Args:
        device: as torch calls it.
    """
    if device.startswith("cuda"):
        import torch

        return torch.cuda.get_device_name(device)
    return _processor()


def _line_of(path: str, key: str) -> str | None:
    """The value of the first line `key : value` of a file, if there is one."""
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return None
    values = (line.partition(":")[2].strip() for line in lines if line.startswith(key))
    return next(values, None)


def _processor() -> str:
    return _line_of("/proc/cpuinfo", "model name") or platform.processor() or platform.machine()


def _memory() -> str | None:
    total = _line_of("/proc/meminfo", "MemTotal")
    return f"{int(total.split()[0]) / 2**20:.0f} GiB" if total else None


def _caches() -> str:
    """For instance "L1 data 48K, L2 2048K, L3 32768K"."""
    caches = []
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        try:
            level, kind, size = ((index / n).read_text().strip() for n in ("level", "type", "size"))
        except OSError:
            continue
        if kind != "Instruction":
            caches.append(f"L{level} {'data ' * (kind == 'Data')}{size}")
    return ", ".join(caches)


def _distribution() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.version() if platform.system() != "Linux" else "unknown distribution"


def _load() -> str:
    """Other programs at work would lengthen wall times first, then CPU times."""
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
