"""How well the distractors of the training views match ground-truth masks, where there are any."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

import numpy as np
import torch
from desplat_ns.console import progress_over
from jaxtyping import Bool
from nerfstudio.cameras.cameras import Cameras
from PIL import Image, UnidentifiedImageError
from torch import Tensor

from desplat_ns.errors import CaptureError
from desplat_ns.evaluation.metrics import mask_iou, mean_alpha_outside

METADATA_KEY = "distractor_mask_filenames"
"""Where the data parser leaves the masks' paths (or None), one for each training photo."""

MASK_LEVEL = 127
"""8-bit grey above which a mask's pixel counts as distractor."""


def score_masks(model: Any, datamanager: Any) -> dict[str, int | float]:
    """`mask_iou`, `alpha_outside_masks` and `num_masks` over the training views that have masks.

    Means over views; `alpha_outside_masks` leaves out views that are covered wholly. Photos with
    lens distortion are left out: training undistorts them, but not their masks. Empty where the
    capture has no masks.

    Raises CaptureError where a mask cannot be read.
    """
    metadata = datamanager.train_dataparser_outputs.metadata
    masks = [
        (_train_camera(datamanager, index), Path(path))
        for index, path in enumerate(metadata.get(METADATA_KEY, []))
        if path is not None
    ]
    masks = [(camera, path) for camera, path in masks if not _is_distorted(camera)]
    if not masks:
        return {}
    ious: list[float] = []
    outside: list[float] = []
    with progress_over(len(masks), "Scoring distractor masks...") as advance:
        for camera, path in masks:
            outputs = model.get_outputs_for_camera(camera)
            alpha = outputs["alpha_distractor"]
            truth = read_mask(path, alpha.shape[1], alpha.shape[0]).to(alpha.device)
            ious.append(mask_iou(outputs["distractor_mask"], truth))
            alpha_outside = mean_alpha_outside(alpha, truth)
            outside += [] if alpha_outside is None else [alpha_outside]
            advance()
    scores = {"mask_iou": statistics.fmean(ious), "num_masks": len(masks)}
    return scores | ({"alpha_outside_masks": statistics.fmean(outside)} if outside else {})


def _train_camera(datamanager: Any, index: int) -> Cameras:
    """The camera of a training view, with the `train_idx` that the datamanager gave it."""
    return datamanager.train_dataset.cameras[index : index + 1].to(datamanager.device)


def _is_distorted(camera: Cameras) -> bool:
    distortion = camera.distortion_params
    return distortion is not None and bool(torch.any(distortion != 0))


def read_mask(path: Path, width: int, height: int) -> Bool[Tensor, "H W 1"]:
    """A mask image (white = distractor) at the given size in pixels, nearest neighbour.

    Raises CaptureError, naming the file, where it is missing or no image.
    """
    try:
        with Image.open(path) as image:
            grey = image.convert("L").resize((width, height), Image.Resampling.NEAREST)
    except (OSError, UnidentifiedImageError) as error:
        raise CaptureError(
            f"The distractor mask {path} cannot be read ({error}). Put an 8-bit PNG there, white "
            "where a distractor is, or remove the `masks` folder to evaluate without masks."
        ) from error
    return torch.from_numpy(np.asarray(grey) > MASK_LEVEL)[..., None]
