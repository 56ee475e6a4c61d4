"""What the training photos see of the scene: which photos to take next, and which places most
photos do not show (the failure case of App. C.3).

Letters in shapes: N Gaussians, P points, V photos.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.cameras.near_plane import sampled
from desplat_ns.cameras.views import detached, image_points, in_image
from desplat_ns.layers import MASK_THRESHOLD
from desplat_ns.separation.decide import Comparison, Thresholds, decide
from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled, region_pixels
from desplat_ns.separation.residuals import Excess, level_of, local_residual
from desplat_ns.training.pipeline import DeSplatPipeline

PLACES = 4_000
"""Opaque static Gaussians that are looked for in the photos, evenly chosen."""
MOST_PHOTOS = 200
"""Training photos; of more, none is looked at: all take minutes, and a part does not tell."""
SAME_DEPTH = 0.1
"""Share of the rendered depth by which a Gaussian may lie behind it and still be seen."""
IN_COMMON = 0.02
"""Share of what a photo shows: two with less in common show different places."""
MUCH = 0.1
"""Share of what a photo shows. Photos that show more than this alone are named."""


@torch.no_grad()
def seen_together(pipeline: DeSplatPipeline) -> tuple[dict[str, float], list[list[str]]]:
    """What training photos share: what `alone` and `apart` say of them."""
    model, names = pipeline.model, pipeline.datamanager.train_image_names
    points = sampled(model.means[torch.sigmoid(model.opacities[:, 0]) > 0.5], PLACES)
    if len(points) == 0 or not 2 <= len(names) <= MOST_PHOTOS:
        return {}, [names]
    shown = torch.stack([_shown(pipeline, points, i) for i in range(len(names))])
    return alone(names, shown), apart(names, shown)


def _shown(
    pipeline: DeSplatPipeline, points: Float[Tensor, "P 3"], index: int
) -> Bool[Tensor, " P"]:
    """Which points a training photo shows, with nothing before them."""
    model = pipeline.model
    camera = pipeline.datamanager.train_dataset.cameras[index : index + 1].to(pipeline.device)
    outputs = model.get_outputs_for_camera(camera)
    view, size = model.view_of_camera(camera, index), outputs["depth"].shape[:2]
    inside, pixel, depth = _places(points, view, *size)
    shown = inside & (depth <= (1 + SAME_DEPTH) * outputs["depth"].flatten()[pixel])
    if "distractor_mask" in outputs:
        shown &= ~outputs["distractor_mask"].flatten()[pixel]
    return shown


def _places(
    points: Float[Tensor, "P 3"], view: View, rows: int, columns: int
) -> tuple[Bool[Tensor, " P"], Int[Tensor, " P"], Float[Tensor, " P"]]:
    """Which points are in the image, the number of the cell of each (0 outside), and depths."""
    u, v, depth = image_points(points, view)
    inside = in_image(u, v, depth)
    row = (torch.where(inside, v, 0.0) * rows).long()
    column = (torch.where(inside, u, 0.0) * columns).long()
    return inside, row * columns + column, depth


def alone(names: Sequence[str], shown: Bool[Tensor, "V P"]) -> dict[str, float]:
    """Photos that alone show more than `MUCH` of what they do, by the points that each shows, with
    that share, the largest first: an object in the way would be taken for the scene there."""
    lonely = shown & (shown.sum(dim=0) == 1)
    shares = (lonely.sum(dim=1) / shown.sum(dim=1).clamp(min=1)).tolist()
    ranked = sorted(zip(shares, names, strict=True), reverse=True)
    return {name: share for share, name in ranked if share > MUCH}


def apart(names: Sequence[str], shown: Bool[Tensor, "V P"]) -> list[list[str]]:
    """Photos in groups, the largest first, none of a single one: two are in one where they share
    `IN_COMMON` of the points that the one which shows fewer does, or others link them."""
    points = shown.float()
    fewer = torch.minimum(*torch.broadcast_tensors(points.sum(1), points.sum(1)[:, None]))
    is_linked = points @ points.T >= IN_COMMON * fewer.clamp(min=1)
    group = torch.arange(len(names))
    for _ in names:  # each takes the least number among those that it is linked with
        group = torch.where(is_linked.cpu(), group, len(names)).amin(dim=1).minimum(group)
    found = [[n for n, g in zip(names, group, strict=True) if g == one] for one in group.unique()]
    return sorted((each for each in found if len(each) > 1), key=len, reverse=True)


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
    by: Thresholds,
) -> Unlike:
    """How a photo differs from the static scene in the photo's light, both in [0, 1], whoever is
    right: regions in which nothing is expected and no other photo is asked."""
    grid, fine = grid_of(view.width, view.height), fine_grid_of(view.width, view.height)
    colors_s, colors_p = pooled(static, fine), pooled(photo, fine)
    residual = local_residual(colors_s, colors_p, grid)
    excess = Excess(residual, level_of(residual, None), torch.ones_like(residual))
    regions = decide(Comparison(colors_s, colors_p, excess, None), lambda: None, by)
    unlike = region_pixels(regions.float(), view.height, view.width)
    covered = (alpha_d.detach() > MASK_THRESHOLD).float()
    cells = pooled(torch.maximum(covered, unlike), grid_of(view.width, view.height, CELLS))[0]
    return Unlike(name, detached(view), cells > 0.5)


@torch.no_grad()
def disputed_places(means: Float[Tensor, "N 3"], photos: Sequence[Unlike]) -> Disputed | None:
    """The disputed places among static Gaussians, if they are more than `MAX_DISPUTED` of those
    that `MIN_VIEWS` photos see. None hides another: an object in the way hides all behind it."""
    if not photos:
        return None
    places, found = sampled(means.detach(), MAX_PLACES), []
    for photo in photos:
        seen, cell, _ = _places(places, photo.view, *photo.cells.shape)
        found.append((seen, seen & photo.cells.flatten()[cell], cell))
    visible, unlike, cells = (torch.stack(part) for part in zip(*found, strict=True))
    times_seen = visible.sum(0)
    judged = times_seen >= MIN_VIEWS
    disputed = judged & (2 * unlike.sum(0) > times_seen)
    share = float(disputed.sum() / judged.sum().clamp(min=1))
    if share <= MAX_DISPUTED:
        return None
    most = max(photo.cells.numel() for photo in photos)  # photos may have several sizes
    hits = torch.zeros(len(photos), most, device=cells.device)
    where = hits.scatter_add(1, cells, (unlike & disputed).float()) > 0
    counts = where.sum(dim=1).tolist()
    order = sorted((i for i, count in enumerate(counts) if count), key=lambda i: -counts[i])
    first = photos[order[0]].cells
    shown = where[order[0], : first.numel()].reshape(first.shape).cpu().numpy()
    return Disputed(share, [photos[i].name for i in order], shown)
