"""What an evaluation reports besides pictures: averages, times, sizes, versions."""

from __future__ import annotations

import math
import os
import platform
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from torch import nn

import desplat_ns

PACKAGES = ("nerfstudio", "gsplat", "torch", "numpy", "numba")
"""Packages that a figure may depend on."""

BYTES_PER_MB = 1e6


@dataclass
class ScoredImage:
    """One evaluated image."""

    name: str
    width: int
    height: int
    metrics: dict[str, float]
    """As the model's `get_image_metrics_and_images` gives them."""
    render_seconds: float
    """Rendering alone."""
    total_seconds: float
    """Rendering and metrics."""


@dataclass
class Stopwatch:
    """Wall-clock seconds; waits for the GPU where there is one."""

    device: torch.device
    _start: float = field(default=0.0)

    def start(self) -> None:
        """Begin at zero."""
        self._start = self._now()

    def seconds(self) -> float:
        """Since `start`."""
        return self._now() - self._start

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()


def summarize(images: Sequence[ScoredImage], with_std: bool) -> dict[str, int | float]:
    """Means over images of every metric and time, plus `*_std` (n - 1) of two images or more.

    Figures that are not finite are left out: they would not be JSON.
    """
    result: dict[str, int | float] = {}
    for key in images[0].metrics:
        values = [float(image.metrics[key]) for image in images if key in image.metrics]
        if not all(math.isfinite(value) for value in values):
            continue
        result[key] = statistics.fmean(values)
        if with_std and len(values) > 1:
            result[f"{key}_std"] = statistics.stdev(values)
    result["num_images"] = len(images)
    result["seconds_per_image_render"] = statistics.fmean(i.render_seconds for i in images)
    result["seconds_per_image_with_metrics"] = statistics.fmean(i.total_seconds for i in images)
    return result


def per_image(images: Sequence[ScoredImage]) -> list[dict[str, Any]]:
    """Name, size and finite metrics of each image, for the JSON."""
    return [
        {"name": image.name, "width": image.width, "height": image.height}
        | {key: value for key, value in image.metrics.items() if math.isfinite(value)}
        for image in images
    ]


def gaussian_counts(model: Any) -> dict[str, int | float]:
    """How many static and distractor Gaussians there are, and the MB (10^6 bytes) they take."""
    distractors = model.distractors
    return {
        "num_static_gaussians": int(model.num_points),
        "num_distractor_gaussians": sum(distractors.counts()) if distractors is not None else 0,
        "static_memory_mb": memory_mb(model.gauss_params),
        "distractor_memory_mb": memory_mb(distractors),
    }


def memory_mb(module: nn.Module | None) -> float:
    """Bytes of a module's parameters, in units of 10^6."""
    if module is None:
        return 0.0
    return sum(p.numel() * p.element_size() for p in module.parameters()) / BYTES_PER_MB


def versions() -> dict[str, str]:
    """Versions of Python, this package and those that a figure may depend on."""
    found = {"python": platform.python_version(), "desplat_ns": desplat_ns.__version__}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def image_names(paths: Sequence[Path]) -> list[str]:
    """Names of image files relative to the folder that they share, with forward slashes."""
    folder = os.path.commonpath([path.parent for path in paths]) if paths else ""
    return [path.relative_to(folder).as_posix() for path in paths]


@contextmanager
def progress_over(total: int, label: str) -> Iterator[Any]:
    """A bar on the console; calling what is yielded advances it by one."""
    columns = (
        TextColumn("[progress.description]{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        MofNCompleteColumn(),
    )
    with Progress(*columns, transient=True) as bar:
        task = bar.add_task(f"[green]{label}", total=total)
        yield lambda: bar.advance(task)
