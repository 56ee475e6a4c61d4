"""How well the distractors of the training views match ground-truth masks, where there are any."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.console import progress_over
from desplat_ns.data.true_masks import read_true_mask
from desplat_ns.evaluation.metrics import mask_iou, mean_alpha_outside


@runtime_checkable
class MaskedModel(Protocol):
    """A model that masks what stands in the way."""

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, Tensor]:
        """`alpha_distractor` and `distractor_mask` [H, W, 1], among others; no gradients."""
        ...


def score_masks(
    model: MaskedModel, masks: Sequence[tuple[Cameras, Path]]
) -> dict[str, int | float]:
    """`mask_iou`, `alpha_outside_masks` and `num_masks` over the training views that have masks.

    Means over views; `alpha_outside_masks` leaves out views that are covered wholly. Photos with
    lens distortion are left out: training undistorts them, but not their masks. Empty if there is
    no mask.

    Args:
        masks: the camera of each view that has a mask, and the mask's file.

    Raises CaptureError where a mask cannot be read.
    """
    masks = [(camera, path) for camera, path in masks if not _is_distorted(camera)]
    if not masks:
        return {}
    ious: list[float] = []
    outside: list[float] = []
    with progress_over(len(masks), "Scoring distractor masks...") as advance:
        for camera, path in masks:
            outputs = model.get_outputs_for_camera(camera)
            alpha = outputs["alpha_distractor"]
            truth = read_true_mask(path, alpha.shape[1], alpha.shape[0]).to(alpha.device)
            ious.append(mask_iou(outputs["distractor_mask"], truth))
            alpha_outside = mean_alpha_outside(alpha, truth)
            outside += [] if alpha_outside is None else [alpha_outside]
            advance()
    scores = {"mask_iou": statistics.fmean(ious), "num_masks": len(masks)}
    return scores | ({"alpha_outside_masks": statistics.fmean(outside)} if outside else {})


def _is_distorted(camera: Cameras) -> bool:
    distortion = camera.distortion_params
    return distortion is not None and bool(torch.any(distortion != 0))
