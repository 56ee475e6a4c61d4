"""What was measured on: GPU, driver, compiler, versions. Nothing that names the machine itself."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

import torch

from desplat_ns.backend.gsplat_kernels.tools import NoKernels, find_tools
from desplat_ns.cores import cores
from desplat_ns.studies.machine import describe_machine
from lab.gpu.plan import Job
from lab.gpu.records import Figures

ALSO = ("Processor", "Memory", "System", "Python", "Commit", "Date")
PACKAGES = ("gsplat", "nerfstudio", "numba", "numpy")


def measure(job: Job) -> Iterator[Figures]:
    """Texts by what they are of."""
    texts = {"GPU": "none: the processor stands in"}
    if not job.is_stand_in:
        texts = gpu()
    described = describe_machine()
    texts |= {
        "torch": f"{torch.__version__}, CUDA {torch.version.cuda or 'none'}",
        "CUDA compiler": compiler() or "none found",
        "Cores": str(cores()),
        **{name: _version(name) for name in PACKAGES},
        **{name: described[name] for name in ALSO},
    }
    yield texts


def gpu() -> Figures:
    """Name, memory and driver of the GPU that torch uses."""
    properties = torch.cuda.get_device_properties(0)
    major, minor = torch.cuda.get_device_capability(0)
    return {
        "GPU": properties.name,
        "GPU memory": f"{properties.total_memory / 2**30:.0f} GiB",
        "Compute capability": f"{major}.{minor}",
        "Driver": driver() or "unknown",
    }


def driver() -> str | None:
    """The driver's version, if `nvidia-smi` tells it."""
    answer = _answer("nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader")
    return answer.split()[0] if answer else None


def compiler() -> str | None:
    """nvcc's version, if there is one that can compile gsplat's kernels."""
    try:
        return f"nvcc {find_tools().cuda}"
    except NoKernels:
        return None


def _answer(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=20).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
