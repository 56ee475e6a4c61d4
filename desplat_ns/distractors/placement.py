"""Puts distractors where a photo shows what the other views do not, and removes them elsewhere.

Eq. 5 alone leaves the sets a choice: while a distractor is faint, both get the same gradient, and
once the composite fits, neither gets any (docs/explain/separation.md works it out for one pixel).
What is added here decides: distractors start only where a photo shows what the other views do not,
are removed where it does not, and the static scene has to fit by itself all pixels that they leave.
"""

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.cameras.views import image_points
from desplat_ns.core.devices import masks_to_host, to_device
from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.distractors.sets import distractors_at
from desplat_ns.separation.grid import grid_of, pooled

LEAST_VIEWS = 2
"""Of two views nobody can tell which is right; a median of three holds against one."""

FEW_VIEWS = 2 * LEAST_VIEWS + 1
"""With fewer training photos a warning is said: of three, two that are occluded alike outvote the
third."""


def about_few_views(num_views: int) -> str:
    """What a user is told who trains on fewer than `FEW_VIEWS` photos."""
    start = f"There are {num_views} training photos. What is in the way is told from the scene by "
    if num_views <= LEAST_VIEWS:
        return (
            f"{start}what most photos of a place show: {LEAST_VIEWS + 1} at least. So distractors "
            "cannot be judged, and none is placed. Add photos, or mask what is in the way."
        )
    return (
        f"{start}what most photos of a place show, and with fewer than {FEW_VIEWS} that is easily "
        "wrong. Look at the distractor masks before trusting them; more photos help."
    )


def distractor_weight(
    alpha_d: Float[Tensor, "H W 1"], in_region: Float[Tensor, "H W 1"] | None = None
) -> Float[Tensor, "H W 1"]:
    """How far a pixel is the distractors', in [0, 1]: the largest of their opacities around it, as
    far as a cell of `grid_of`, since edges are half-transparent; 1 where `in_region` is."""
    plane = alpha_d[..., 0].detach()
    height, width = plane.shape
    size = 2 * round(width / grid_of(width, height)[0]) + 1
    if plane.is_cpu:
        maxima = torch.from_numpy(cv2.dilate(plane.numpy(), np.ones((size, size), np.uint8)))
    else:
        rows = F.max_pool1d(plane, size, 1, size // 2)  # row by row: a tenth of max_pool2d's time
        maxima = F.max_pool1d(rows.T.contiguous(), size, 1, size // 2).T
    weight = maxima[..., None]
    return weight if in_region is None else torch.maximum(weight, in_region)


def placement(
    view: View,
    photo: Float[Tensor, "H W 3"],
    alpha_d: Float[Tensor, "H W 1"],
    regions: Bool[Tensor, "rows columns"],
    means: Float[Tensor, "N 3"],
    config: DistractorConfig,
) -> tuple[Tensor, dict[str, Tensor]] | None:
    """Which of a view's distractors stay, as numbers of rows, and new ones in the photo's colours,
    one in each cell of `regions` that is not half covered; None for no change. `regions`: where
    distractors belong, on the grid of `grid_of`."""
    rows, columns = regions.shape
    uncovered = regions & (pooled(alpha_d, (columns, rows))[0] < 0.5)
    stays, uncovered = masks_to_host(lie_in(regions, means, view), uncovered)
    if stays.all() and not uncovered.any():
        return None
    kept = to_device(np.flatnonzero(stays), photo.device)
    row, column = to_device(np.stack(uncovered.nonzero()), photo.device)
    x = (column + 0.5) * view.width / columns
    y = (row + 0.5) * view.height / rows
    pixels, colors = torch.stack([x, y], dim=-1), pooled(photo, (columns, rows))[:, row, column]
    return kept, distractors_at(view, uncovered.size, config, pixels, colors.T.contiguous())


def lie_in(
    regions: Bool[Tensor, "rows columns"], means: Float[Tensor, "N 3"], view: View
) -> Bool[Tensor, " N"]:
    """Which Gaussians have their centre in a region; beyond the border, the nearest cell counts."""
    rows, columns = regions.shape
    u, v, _ = image_points(means.detach(), view)
    row, column = (v * rows).long(), (u * columns).long()
    return regions[row.clamp(0, rows - 1), column.clamp(0, columns - 1)]
