"""The machine that something is measured on, in words. Nothing that names the machine itself."""

import platform
from importlib.metadata import version

import psutil

from desplat_ns.core.cores import cores
from desplat_ns.tools.studies.machine import code_version, processor, short, today

PACKAGES = ("torch", "numba", "llvmlite", "numpy", "gsplat", "nerfstudio")


def describe_machine() -> dict[str, str]:
    """Processor, memory, system, versions, commit and date, each as a text to print."""
    return {
        "Processor": processor(),
        "Cores": str(cores()),
        "Memory": f"{psutil.virtual_memory().total / 2**30:.0f} GiB",
        "System": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "Commit": short(code_version()),
        "Date": today(),
    }
