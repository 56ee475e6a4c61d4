"""gsplat's kernels: its wheel brings sources, and the first use compiles them, for minutes."""

from __future__ import annotations

import time
from collections.abc import Iterator

from desplat_ns.backend import resolve
from desplat_ns.backend.gsplat_kernels import build, kernels
from desplat_ns.calibration.scenes import make_scene
from lab.gpu.plan import Job
from lab.gpu.records import Figures
from lab.pixels.rasterizing import SETTINGS

TINY = (50, 48, 32)
"""Gaussians, width and height of what is drawn to see whether the kernels run."""


def measure(job: Job) -> Iterator[Figures]:
    """Compile them, or load those that are there, and draw with them once.

    Raises:
        BackendUnavailableError: there are neither kernels nor what compiles them.
    """
    began = time.perf_counter()
    if not job.is_stand_in:
        kernels.try_again()
        resolve("gsplat", "cuda")
    built = time.perf_counter() - began
    scene = make_scene(*TINY)
    splats, view = scene.splats(device=job.device), scene.view_as(device=job.device)
    drawn = resolve(job.backend, job.device)(splats, view, SETTINGS)  # pyright: ignore[reportArgumentType]
    drawn.rgb.sum().backward()
    if not bool(drawn.rgb.isfinite().all()):
        raise ValueError("The kernels drew colours that are not finite numbers.")
    yield {
        "seconds": round(built, 1),
        "jobs": build.jobs(),
        "architecture": "" if job.is_stand_in else kernels.architectures(),
    }
