"""All images of a split scored: what `ns-eval` writes and TensorBoard plots."""

from __future__ import annotations

import math
import platform
import statistics
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn

import desplat_ns
from desplat_ns.console import progress_over
from desplat_ns.errors import CaptureError, DeSplatError
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.mask_scores import score_masks
from desplat_ns.evaluation.scorer import ScoredImage, Scorer
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.model import DeSplatModel

Image = tuple[Cameras, dict[str, Any]]
"""A camera and its photo, as nerfstudio's datamanager gives them."""

Show = Callable[[int, dict[str, Tensor]], None]
"""Gets the number of an image and its pictures [H, W, 3] in [0, 1] by name."""

PACKAGES = ("nerfstudio", "gsplat", "torch", "numpy", "numba")
"""Packages that a figure may depend on."""


def evaluate_in_training(
    model: DeSplatModel, images: Sequence[Image], names: Sequence[str], show: Show
) -> dict[str, Any]:
    """Means over whole images in the average light, times and counts: numbers alone, as event
    writers need them.

    Raises:
        CaptureError: there is no image.
    """
    scored = _score(Scorer(model), images, names, show)
    return summarize(scored, False) | gaussian_counts(model.gauss_params, model.distractors)


def evaluate(
    model: DeSplatModel,
    config: EvaluationConfig,
    images: Sequence[Image],
    names: Sequence[str],
    masks: Sequence[tuple[Cameras, Path]],
    show: Show,
) -> dict[str, Any]:
    """Means and standard deviations (of two images or more), figures of each image, mask scores,
    and texts that say what was measured.

    Args:
        names: of the split's photos; a batch's `image_idx` is a place in them.
        masks: the camera of each training view whose distractors are known, and their mask.

    Raises:
        CaptureError: there is no image.
        ConfigError: the protocol does not fit the model.
        DeSplatError: a figure of an image is not a finite number.
    """
    scorer = Scorer.of(model, config)
    model.lpips.use(config.lpips_net)
    if images:  # compilation and caches are no part of the time per image
        model.get_outputs_for_camera(images[0][0])
    scored = _score(scorer, images, names, show)
    bad = [i.name for i in scored if not all(math.isfinite(v) for v in i.metrics.values())]
    if bad:
        raise DeSplatError(
            f"The renderings of {len(bad)} of {len(scored)} images hold values that are not "
            f"finite, the first being '{bad[0]}'. Training has diverged; evaluate an earlier "
            "checkpoint by setting `load_step` in the run's config.yml, or train with lower "
            "learning rates."
        )
    results: dict[str, Any] = {**summarize(scored, True)}
    results |= gaussian_counts(model.gauss_params, model.distractors)
    if model.distractors is not None:
        results |= score_masks(model.get_outputs_for_camera, masks)
    results["backend"], results["device"] = model.rasterizer.name, str(model.device)
    own = {"python": platform.python_version(), "desplat_ns": desplat_ns.__version__}
    results["versions"] = own | {package: version(package) for package in PACKAGES}
    reason = model.lpips.reason
    results |= {"lpips_net": model.lpips.net} if reason is None else {"lpips_reason": reason}
    results["protocol"] = scorer.describe()
    results["images"] = [
        {"name": i.name, "width": i.width, "height": i.height} | i.metrics for i in scored
    ]
    return results


def _score(
    scorer: Scorer, images: Sequence[Image], names: Sequence[str], show: Show
) -> list[ScoredImage]:
    if not images:
        raise CaptureError(
            "The capture has no evaluation images, so there is nothing to score. Choose a "
            "split that has some, with the data parser's `--eval-mode` or its split options."
        )
    scored: list[ScoredImage] = []
    with progress_over(len(images), "Evaluating all images...") as advance:
        for index, (camera, batch) in enumerate(images):
            name = names[int(batch.get("image_idx", index))]
            scores, pictures = scorer.score(camera, batch, name)
            scored.append(scores)
            show(index, pictures)
            advance()
    return scored


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


def gaussian_counts(
    static: nn.ParameterDict, distractors: DistractorGaussians | None
) -> dict[str, int | float]:
    """How many static and distractor Gaussians there are, and the MB (10^6 bytes) they take."""
    views = [] if distractors is None else distractors.views

    def mb(parameters: Iterable[Tensor]) -> float:
        return sum(p.numel() * p.element_size() for p in parameters) / 1e6

    return {
        "num_static_gaussians": len(static["means"]),
        "num_distractor_gaussians": sum(len(view) for view in views),
        "static_memory_mb": mb(static.values()),
        "distractor_memory_mb": mb(p for view in views for p in view.params.values()),
    }
