"""gsplat's kernels: its wheel brings sources, and the first use compiles them, for minutes."""

from __future__ import annotations

import importlib
import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import torch
from torch.utils import cpp_extension

from benchmarks.gpu.plan import Job
from benchmarks.gpu.records import Figures
from desplat_ns.backend import resolve
from desplat_ns.calibration.scenes import make_scene
from desplat_ns.errors import BackendUnavailableError
from desplat_ns.studies.pixels.rasterizing import SETTINGS

TINY = (50, 48, 32)
"""Gaussians, width and height of what is drawn to see whether the kernels run."""


def measure(job: Job) -> Iterator[Figures]:
    """Compile them, or load those that are there, and draw with them once.

    Raises:
        BackendUnavailableError: there is neither a CUDA compiler nor are there kernels.
    """
    began = time.perf_counter()
    if not job.is_stand_in:
        build()
    built = time.perf_counter() - began
    scene = make_scene(*TINY)
    splats, view = scene.splats(device=job.device), scene.view_as(device=job.device)
    drawn = resolve(job.backend, job.device)(splats, view, SETTINGS)  # pyright: ignore[reportArgumentType]
    drawn.rgb.sum().backward()
    if not bool(drawn.rgb.isfinite().all()):
        raise ValueError("The kernels drew colours that are not finite numbers.")
    yield {
        "seconds": round(built, 1),
        "jobs": int(os.environ.get("MAX_JOBS", "0")),
        "architecture": os.environ.get("TORCH_CUDA_ARCH_LIST", ""),
    }


def build() -> None:
    """gsplat's own build, for the GPU at hand alone."""
    major, minor = torch.cuda.get_device_capability(0)
    os.environ["TORCH_CUDA_ARCH_LIST"] = f"{major}.{minor}"
    os.environ["PATH"] = os.pathsep.join([*tool_folders(), os.environ.get("PATH", "")])
    # Imported by itself, so that what the compiler says is not lost.
    kernels = importlib.import_module("gsplat.cuda._backend")
    if getattr(kernels, "_C", None) is None:
        found = shutil.which("nvcc") or "none"
        raise BackendUnavailableError(
            f"gsplat has no kernels and no compiler for them (nvcc: {found}). Install the CUDA "
            f"toolkit {torch.version.cuda}, which torch was built with, and put nvcc on PATH."
        )


def tool_folders() -> list[str]:
    """Where nvcc and ninja may be although PATH does not say so: in torch's CUDA toolkit, and
    beside the packages that this process imports."""
    places = [Path(place).parents[2] / "bin" for place in sys.path if "site-packages" in place]
    if cpp_extension.CUDA_HOME is not None:
        places.insert(0, Path(cpp_extension.CUDA_HOME) / "bin")
    return [str(place) for place in dict.fromkeys(places) if place.is_dir()]
