"""How well the distractors of the training views match ground-truth masks, where there are any."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path

from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.console import progress_over
from desplat_ns.data.gt_masks import read_gt_mask
from desplat_ns.rendering.metrics import mask_iou, mean_alpha_outside
from desplat_ns.rendering.views import is_distorted


def score_masks(
    draw: Callable[[Cameras], dict[str, Tensor]], masks: Sequence[tuple[Cameras, Path]]
) -> dict[str, int | float]:
    """`mask_iou`, `alpha_outside_masks` and `num_masks` over the training views that have masks.

    Means over views; `alpha_outside_masks` leaves out views that are covered wholly. Photos with
    lens distortion are left out: training undistorts them, but not their masks. Empty if there is
    no mask.

    Args:
        draw: gives `alpha_distractor` and `distractor_mask` [H, W, 1] of a camera; no gradients.
        masks: the camera of each view that has a mask, and the mask's file.

    Raises CaptureError where a mask cannot be read.
    """
    masks = [(camera, path) for camera, path in masks if not is_distorted(camera)]
    if not masks:
        return {}
    scores: dict[str, list[float]] = defaultdict(list)
    with progress_over(len(masks), "Scoring distractor masks...") as advance:
        for camera, path in masks:
            outputs = draw(camera)
            alpha = outputs["alpha_distractor"]
            truth = read_gt_mask(path, alpha.shape[1], alpha.shape[0]).to(alpha.device)
            scores["mask_iou"].append(mask_iou(outputs["distractor_mask"], truth))
            outside = mean_alpha_outside(alpha, truth)
            if outside is not None:
                scores["alpha_outside_masks"].append(outside)
            advance()
    means = {name: statistics.fmean(values) for name, values in scores.items()}
    return means | {"num_masks": len(masks)}
