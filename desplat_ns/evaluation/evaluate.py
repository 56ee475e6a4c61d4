"""Images scored, in a light and on a region: what `ns-eval` writes and TensorBoard plots."""

import math
import platform
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

import desplat_ns
from desplat_ns.cameras.views import is_distorted
from desplat_ns.core.console import progress_over
from desplat_ns.core.errors import CaptureError, ConfigError, DeSplatError
from desplat_ns.core.options import check_ranges
from desplat_ns.data.images import read_gt_mask
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.halves import embedding_from_left_half, right_half
from desplat_ns.metrics import mask_iou, mean_alpha_outside
from desplat_ns.model import DeSplatModel

Image = tuple[Cameras, dict[str, Any]]
"""A camera and its photo, as nerfstudio's datamanager gives them."""

Show = Callable[[int, Tensor], None]
"""Gets the number of an image, and the photo beside the rendering: [H, 2 W, 3] in [0, 1]."""

PACKAGES = ("nerfstudio", "gsplat", "torch", "numpy", "numba")
"""Packages that a figure may depend on."""


@dataclass
class Scorer:
    """One way to score images."""

    model: DeSplatModel
    region: Literal["full image", "right half"] = "full image"
    """Which pixels count."""
    fit: EvaluationConfig | None = None
    """How each image's light is found on its left half, the protocol of Photo Tourism (App. B.1);
    None: it is the training images' average."""

    @classmethod
    def of(cls, model: DeSplatModel, config: EvaluationConfig) -> "Scorer":
        """The scorer that the options ask for. Raises ConfigError where they cannot be met."""
        check_ranges(config, "-")
        has_light = model.effects.image_light
        if config.protocol == "half" and not has_light:
            raise ConfigError(
                "The half protocol finds an image's embedding, and this model has none: its "
                "effects.appearance is off. Evaluate by `desplat-eval --protocol full`, or train "
                "with `--pipeline.model.effects.appearance affine`."
            )
        if config.protocol in ("half", "auto") and has_light:
            return cls(model, "right half", config)
        return cls(model, "right half" if config.protocol == "right" else "full image")

    def describe(self) -> str:
        """The way in words, for the JSON."""
        text = f"{self.region}, static Gaussians only"
        if self.fit is None:
            whole = self.region == "full image"
            return text if whole else f"{text}; no embedding of the image's own"
        how = f"{self.fit.steps} steps of Adam at {self.fit.learning_rate:g}"
        how = "in closed form" if self.model.effects.closed_form else how
        return f"{text}; each image's embedding: {how} on its left half"

    def score(self, camera: Cameras, batch: dict[str, Any]) -> tuple[dict[str, float], Tensor]:
        """Figures and seconds of one image, figures in the average light as `*_before` if it has
        its own; and what `Show` gets."""
        model, image, start = self.model, batch["image"], self._now()
        outputs = model.get_outputs_for_camera(camera)
        render_seconds = self._now() - start
        figures = self._figures(outputs, batch)
        if self.fit is not None:
            before = {f"{key}_before": value for key, value in figures.items()}
            start = self._now()
            photo, mask = model.photo_of(outputs["background"], image), batch.get("mask")
            if image.shape[2] == 4:  # what is transparent does not count
                opaque = image[..., 3:] > 0
                mask = opaque if mask is None else opaque & (mask.to(opaque.device) != 0)
            embedding = embedding_from_left_half(model, camera, photo, self.fit, mask)
            before["embedding_seconds"] = self._now() - start
            start = self._now()
            with model.shown_light.fixed(embedding):
                outputs = model.get_outputs_for_camera(camera)
            figures = self._figures(outputs, batch) | before
        figures["seconds_per_image_render"] = render_seconds
        figures["seconds_per_image_with_metrics"] = self._now() - start
        photo = model.photo_of(outputs["background"], image)
        return figures, torch.cat([photo, outputs["rgb"]], dim=1)

    def _now(self) -> float:
        """Seconds; what the GPU was given is done."""
        if self.model.device.type == "cuda":
            torch.cuda.synchronize(self.model.device)
        return time.perf_counter()

    def _figures(self, outputs: dict[str, Tensor], batch: dict[str, Any]) -> dict[str, float]:
        if self.region == "right half":
            outputs = {name: right_half(outputs[name]) for name in ("rgb", "background")}
            batch = {**batch, "image": right_half(batch["image"])}
        return self.model.get_image_metrics_and_images(outputs, batch)[0]


def evaluate_in_training(
    model: DeSplatModel, images: Sequence[Image], names: Sequence[str], show: Show
) -> dict[str, Any]:
    """Means over whole images in the average light, times and counts: numbers alone, as event
    writers need them. Raises CaptureError where there is no image."""
    scored = _score(Scorer(model), images, names, show)
    return summarize(scored, False) | gaussian_counts(model)


def evaluate(
    model: DeSplatModel,
    config: EvaluationConfig,
    images: Sequence[Image],
    names: Sequence[str],
    masks: Sequence[tuple[Cameras, Path]],
    show: Show,
) -> dict[str, Any]:
    """Means and standard deviations (of two images or more), figures of each image, mask scores,
    and texts that say what was measured. Raises CaptureError where there is no image, DeSplatError
    where a figure is not finite, and as `Scorer.of`. `names`: by a batch's `image_idx`."""
    scorer = Scorer.of(model, config)
    model.lpips.use(config.lpips_net)
    if images:  # compilation and caches are no part of the time per image
        model.get_outputs_for_camera(images[0][0])
    scored = _score(scorer, images, names, show)
    for image in scored:
        if not all(math.isfinite(v) for v in image.values() if isinstance(v, float)):
            raise DeSplatError(
                f"The rendering of '{image['name']}' holds values that are not finite: training "
                "has diverged. Evaluate an earlier checkpoint by setting `load_step` in the run's "
                "config.yml, or train with lower learning rates."
            )
    results: dict[str, Any] = {**summarize(scored, True), **gaussian_counts(model)}
    if model.distractors is not None:
        results |= score_masks(model, masks)
    results["backend"], results["device"] = model.rasterizer.name, str(model.device)
    own = {"python": platform.python_version(), "desplat_ns": desplat_ns.__version__}
    results["versions"] = own | {package: version(package) for package in PACKAGES}
    reason = model.lpips.reason
    results |= {"lpips_net": model.lpips.net} if reason is None else {"lpips_reason": reason}
    results["protocol"] = scorer.describe()
    results["images"] = scored
    return results


def _score(
    scorer: Scorer, images: Sequence[Image], names: Sequence[str], show: Show
) -> list[dict[str, Any]]:
    """Name, size, figures and seconds of each image."""
    if not images:
        raise CaptureError(
            "The capture has no evaluation images, so there is nothing to score. Choose a "
            "split that has some, with the data parser's `--eval-mode` or its split options."
        )
    scored = []
    with progress_over(len(images), "Evaluating all images...") as advance:
        for index, (camera, batch) in enumerate(images):
            name = names[int(batch.get("image_idx", index))]
            figures, beside = scorer.score(camera, batch)
            size = {"width": int(camera.width), "height": int(camera.height)}
            scored.append({"name": name} | size | figures)
            show(index, beside)
            advance()
    return scored


def summarize(images: Sequence[dict[str, Any]], with_std: bool) -> dict[str, int | float]:
    """Means over images of every figure and time, plus `*_std` (n - 1) of two images or more, and
    the PSNR of the worst. Figures that are not finite are left out: they would not be JSON."""
    result: dict[str, int | float] = {}
    for key in (key for key, value in images[0].items() if isinstance(value, float)):
        values = [image[key] for image in images if key in image]
        if not all(math.isfinite(value) for value in values):
            continue
        result[key] = statistics.fmean(values)
        if with_std and len(values) > 1:
            result[f"{key}_std"] = statistics.stdev(values)
        if with_std and key == "psnr":
            result["psnr_worst"] = min(values)
    result["num_images"] = len(images)
    return result


def gaussian_counts(model: DeSplatModel) -> dict[str, int | float]:
    """How many static and distractor Gaussians there are, and the MB (10^6 bytes) they take."""
    static, views = model.gauss_params, [] if model.distractors is None else model.distractors.views

    def mb(parameters: Iterable[Tensor]) -> float:
        return sum(p.numel() * p.element_size() for p in parameters) / 1e6

    return {
        "num_static_gaussians": len(static["means"]),
        "num_distractor_gaussians": sum(len(view) for view in views),
        "static_memory_mb": mb(static.values()),
        "distractor_memory_mb": mb(p for view in views for p in view.params.values()),
    }


def score_masks(
    model: DeSplatModel, masks: Sequence[tuple[Cameras, Path]]
) -> dict[str, int | float]:
    """`mask_iou` and `alpha_outside_masks`, means over the training views that have masks, and
    `num_masks`; empty if there is none. Raises CaptureError where a mask cannot be read.

    `alpha_outside_masks` leaves out views that are covered wholly. Photos with lens distortion are
    left out: training undistorts them, but not their masks.
    """
    masks = [(camera, path) for camera, path in masks if not is_distorted(camera)]
    if not masks:
        return {}
    scores: dict[str, list[float]] = defaultdict(list)
    with progress_over(len(masks), "Scoring distractor masks...") as advance:
        for camera, path in masks:
            outputs = model.get_outputs_for_camera(camera)
            alpha = outputs["alpha_distractor"]
            truth = read_gt_mask(path, alpha.shape[1], alpha.shape[0]).to(alpha.device)
            scores["mask_iou"].append(mask_iou(outputs["distractor_mask"], truth))
            if (outside := mean_alpha_outside(alpha, truth)) is not None:
                scores["alpha_outside_masks"].append(outside)
            advance()
    means = {name: statistics.fmean(values) for name, values in scores.items()}
    return means | {"num_masks": len(masks)}
