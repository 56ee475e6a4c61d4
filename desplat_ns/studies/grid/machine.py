"""What the figures were measured on. Nothing that names the machine itself."""

from __future__ import annotations

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path

from desplat_ns.calibration.timing import all_cores
from desplat_ns.studies.grid.code_version import code_version, short

PACKAGES = ("torch", "numba", "llvmlite", "numpy", "gsplat", "pytorch-msssim")


def describe_machine() -> dict[str, str]:
    """Processor, caches, memory, system, versions, commit and date, each as a text to print."""
    return {
        "Processor": _processor(),
        "Cores used": f"1, and {all_cores()}",
        "Caches": _caches() or "unknown",
        "Memory": _memory() or "unknown",
        "System": f"{platform.system()} {platform.machine()}, {_distribution()}",
        "Load before the run": _load(),
        "Python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "Commit": short(code_version()),
        "Date": datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
    }


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
    found = _line_of("/proc/meminfo", "MemTotal")
    return f"{int(found.split()[0]) / 2**20:.0f} GiB" if found else None


def _caches() -> str:
    """For instance "L1 data 48K, L2 2048K, L3 32768K"."""
    found = []
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        try:
            level, kind, size = ((index / n).read_text().strip() for n in ("level", "type", "size"))
        except OSError:
            continue
        if kind != "Instruction":
            found.append(f"L{level} {'data ' * (kind == 'Data')}{size}")
    return ", ".join(found)


def _distribution() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.version() if platform.system() != "Linux" else "unknown distribution"


def _load() -> str:
    """Other programs at work would lengthen wall times first, then CPU times."""
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
