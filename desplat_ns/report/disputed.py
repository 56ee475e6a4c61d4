"""Finds places of the scene that most photos do not show: the failure case of App. C.3.

Letters in shapes: N Gaussians, V views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.backend.constants import NEAR_PLANE
from desplat_ns.backend.protocol import View
from desplat_ns.gaussians.distractor_config import DistractorConfig
from desplat_ns.rendering.layers import MASK_THRESHOLD
from desplat_ns.rendering.near_plane import sampled
from desplat_ns.rendering.views import held, image_points
from desplat_ns.separation.grid import grid_of, pooled, region_pixels
from desplat_ns.separation.regions import differences

CELLS = 2000
"""Cells of an image that are compared with the static scene."""

MIN_VIEWS = 5
"""A place that fewer views see is not judged: chance hides it too often."""

MAX_DISPUTED = 0.02
"""Share of disputed places above which a user is told. A place is disputed if more than half of the
views that see it show something else. With objects that stand elsewhere in each photo, pasted over
a fifth of it, the share is 0.1%, and 1% of a thin tree before a bright sky."""

MAX_PLACES = 10_000
"""Static Gaussians that are judged, evenly chosen."""


@dataclass(frozen=True)
class Unlike:
    """Where a training photo does not show the static scene."""

    name: str
    view: View
    cells: Bool[Tensor, "rows columns"]
    """Cells that differ from the static scene or that distractors cover."""


@dataclass(frozen=True)
class Disputed:
    """Places that most of the photos that see them do not show."""

    share: float
    """Of the places that are judged, in [0, 1]."""
    names: list[str]
    """Photos that do not show them, those with most such cells first."""
    where: Bool[np.ndarray, "rows columns"]
    """Cells of the first of these photos."""


def unlike_in(
    name: str,
    view: View,
    alpha_d: Float[Tensor, "H W 1"],
    photo: Float[Tensor, "H W 3"],
    static: Float[Tensor, "H W 3"],
    config: DistractorConfig,
) -> Unlike:
    """How a photo differs from the static scene in the photo's light, both in [0, 1]; under the
    user's mask they are the same."""
    covered = (alpha_d.detach() > MASK_THRESHOLD).float()
    unlike = region_pixels(differences(photo, static, config).float(), view.height, view.width)
    cells = pooled(torch.maximum(covered, unlike), grid_of(view.width, view.height, CELLS))[0]
    return Unlike(name, held(view), cells > 0.5)


def _seen_and_unlike(
    means: Float[Tensor, "N 3"], photo: Unlike
) -> tuple[Bool[Tensor, " N"], Bool[Tensor, " N"], Int[Tensor, " N"]]:
    """Which places are in the image, which of these it does not show, and their cells. Static
    Gaussians do not hide one another here: an object in the way hides all behind it."""
    rows, columns = photo.cells.shape
    u, v, depth = image_points(means, photo.view)
    column, row = u * columns, v * rows
    visible = (depth > NEAR_PLANE) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = torch.where(visible, row.floor() * columns + column.floor(), 0.0).long()
    return visible, visible & photo.cells.flatten()[cell], cell


@torch.no_grad()
def disputed_places(means: Float[Tensor, "N 3"], photos: Sequence[Unlike]) -> Disputed | None:
    """The disputed places among static Gaussians, if more than `MAX_DISPUTED` of those that
    `MIN_VIEWS` photos see are."""
    if not photos:
        return None
    found = [_seen_and_unlike(sampled(means.detach(), MAX_PLACES), photo) for photo in photos]
    visible, unlike, cells = (torch.stack(part) for part in zip(*found, strict=True))
    times_seen = visible.sum(0)
    judged = times_seen >= MIN_VIEWS
    disputed = judged & (2 * unlike.sum(0) > times_seen)
    share = float(disputed.sum() / judged.sum().clamp(min=1))
    if share <= MAX_DISPUTED:
        return None
    hits = torch.zeros(len(photos), photos[0].cells.numel(), device=cells.device)
    where = hits.scatter_add(1, cells, (unlike & disputed).float()) > 0
    counts = where.sum(dim=1).tolist()
    order = sorted((i for i, count in enumerate(counts) if count), key=lambda i: -counts[i])
    shown = where[order[0]].reshape(photos[order[0]].cells.shape).cpu().numpy()
    return Disputed(share, [photos[i].name for i in order], shown)
