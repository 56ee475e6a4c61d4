"""The figures of an evaluation: averages over images, times, numbers of Gaussians, versions."""

from __future__ import annotations

import math
import platform
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from torch import Tensor, nn

import desplat_ns
from desplat_ns.errors import DeSplatError
from desplat_ns.gaussians.distractors import DistractorGaussians

PACKAGES = ("nerfstudio", "gsplat", "torch", "numpy", "numba")
"""Packages that a figure may depend on."""


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


def summarize(images: Sequence[ScoredImage], with_std: bool) -> dict[str, int | float]:
    """Means over images of every metric and time, plus `*_std` (n - 1) of two images or more, and
    the PSNR of the worst.

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
        if with_std and key == "psnr":
            result["psnr_worst"] = min(values)
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


def check_finite(images: Sequence[ScoredImage]) -> None:
    """Raise DeSplatError, naming an image, if a figure of any is not a finite number."""
    bad = [i.name for i in images if not all(math.isfinite(v) for v in i.metrics.values())]
    if bad:
        raise DeSplatError(
            f"The renderings of {len(bad)} of {len(images)} images hold values that are not "
            f"finite, the first being '{bad[0]}'. Training has diverged; evaluate an earlier "
            "checkpoint by setting `load_step` in the run's config.yml, or train with lower "
            "learning rates."
        )


def gaussian_counts(
    static: nn.ParameterDict, distractors: DistractorGaussians | None
) -> dict[str, int | float]:
    """How many static and distractor Gaussians there are, and the MB (10^6 bytes) they take."""
    views = [] if distractors is None else distractors.views
    of_views = [parameter for view in views for parameter in view.params.values()]
    return {
        "num_static_gaussians": len(static["means"]),
        "num_distractor_gaussians": sum(len(view) for view in views),
        "static_memory_mb": memory_mb(static.values()),
        "distractor_memory_mb": memory_mb(of_views),
    }


def memory_mb(parameters: Iterable[Tensor]) -> float:
    """Bytes of parameters, in units of 10^6."""
    return sum(p.numel() * p.element_size() for p in parameters) / 1e6


def versions() -> dict[str, str]:
    """Versions of Python, this package and those that a figure may depend on."""
    own = {"python": platform.python_version(), "desplat_ns": desplat_ns.__version__}
    return own | {package: version(package) for package in PACKAGES}
