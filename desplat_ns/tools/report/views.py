"""What the training photos see of the scene: which photos to take next, and whether it is one.
Letters in shapes: P points, V photos."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.cameras.near_plane import sampled
from desplat_ns.cameras.views import image_points, in_image
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
    (rows, columns), view = outputs["depth"].shape[:2], model.view_of_camera(camera, index)
    u, v, depth = image_points(points, view)
    shown = in_image(u, v, depth)
    row = torch.where(shown, v * rows, 0).long().clamp(max=rows - 1)
    column = torch.where(shown, u * columns, 0).long().clamp(max=columns - 1)
    shown &= depth <= (1 + SAME_DEPTH) * outputs["depth"][row, column, 0]
    if "distractor_mask" in outputs:
        shown &= ~outputs["distractor_mask"][row, column, 0]
    return shown


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
