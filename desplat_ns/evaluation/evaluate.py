"""All images of a split scored: what `ns-eval` writes and TensorBoard plots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.console import progress_over
from desplat_ns.errors import CaptureError
from desplat_ns.evaluation.config import EvaluationConfig, chosen_protocol
from desplat_ns.evaluation.mask_scores import score_masks
from desplat_ns.evaluation.records import (
    ScoredImage,
    check_finite,
    gaussian_counts,
    per_image,
    summarize,
    versions,
)
from desplat_ns.evaluation.scorer import Scorer
from desplat_ns.model import DeSplatModel

Image = tuple[Cameras, dict[str, Any]]
"""A camera and its photo, as nerfstudio's datamanager gives them."""

Show = Callable[[int, dict[str, Tensor]], None]
"""Gets the number of an image and its pictures [H, W, 3] in [0, 1] by name."""


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
    scorer = scorer_of(model, config)
    model.lpips.use(config.lpips_net)
    if images:  # compilation and caches are no part of the time per image
        model.get_outputs_for_camera(images[0][0])
    scored = _score(scorer, images, names, show)
    check_finite(scored)
    results: dict[str, Any] = {**summarize(scored, True)}
    results |= gaussian_counts(model.gauss_params, model.distractors)
    if model.distractors is not None:
        results |= score_masks(model.get_outputs_for_camera, masks)
    results["backend"], results["device"] = model.rasterizer.name, str(model.device)
    results["versions"], reason = versions(), model.lpips.reason
    results |= {"lpips_net": model.lpips.net} if reason is None else {"lpips_reason": reason}
    results["protocol"], results["images"] = scorer.describe(), per_image(scored)
    return results


def scorer_of(model: DeSplatModel, config: EvaluationConfig) -> Scorer:
    """The scorer that the options ask for. Raises ConfigError as `evaluate`."""
    protocol = chosen_protocol(config, model.effects.image_light)
    if protocol != "half":
        return Scorer(model, "full image" if protocol == "full" else "right half")
    return Scorer(model, "right half", config)


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
