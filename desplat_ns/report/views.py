"""Which views can be trusted, and which photos to take next: what the training photos see.

Letters in shapes: P points, V photos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.data.training_views import image_names
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.near_plane import sampled
from desplat_ns.rendering.views import image_points, views_of

PLACES = 4_000
"""Opaque static Gaussians that are looked for in the photos, evenly chosen."""

MOST_PHOTOS = 200
"""Training photos; with more, none is said to show something alone: to look at all takes minutes,
and a part of them does not tell."""

SAME_DEPTH = 0.1
"""Share of the rendered depth by which a Gaussian may lie behind it and still be seen."""

MUCH = 0.1
"""Share of what a photo shows. Photos that show more than this alone are named."""


def angles_of_held_out(pipeline: DeSplatPipeline) -> dict[str, float]:
    """Degrees from the training photos (`PhotoAngle`) of the held-out photos, by name; empty where
    the scene did not start from a reconstruction."""
    model, photos = pipeline.model, pipeline.datamanager.eval_dataset
    if not model.has_points:
        return {}
    names = image_names(photos.image_filenames)
    angles = map(model.photo_angle.degrees, views_of(photos.cameras.to(pipeline.device)))
    return {name: angle for name, angle in zip(names, angles, strict=True) if angle is not None}


@dataclass(frozen=True)
class Alone:
    """A photo that shows a part of the scene that no other photo shows. Nobody can check that part:
    its depth is not known, and an object in the way would be taken for the scene."""

    name: str
    share: float
    """Of what the photo shows of the scene."""
    side: str
    """Where in the photo that part lies, in words."""


@torch.no_grad()
def seen_alone(pipeline: DeSplatPipeline) -> list[Alone]:
    """Training photos that show much of the scene alone; those that show most first."""
    model, names = pipeline.model, pipeline.datamanager.train_image_names
    points = sampled(model.means[torch.sigmoid(model.opacities[:, 0]) > 0.5], PLACES)
    if len(points) == 0 or not 2 <= len(names) <= MOST_PHOTOS:
        return []
    shown, places = zip(*(_shown(pipeline, points, i) for i in range(len(names))), strict=True)
    return alone(names, torch.stack(shown), torch.stack(places))


def _shown(
    pipeline: DeSplatPipeline, points: Float[Tensor, "P 3"], index: int
) -> tuple[Bool[Tensor, " P"], Float[Tensor, "P 2"]]:
    """Which points a training photo shows, with nothing before them, and where in it they lie."""
    model = pipeline.model
    camera = pipeline.datamanager.train_dataset.cameras[index : index + 1].to(pipeline.device)
    outputs = model.get_outputs_for_camera(camera)
    u, v, depth = image_points(points, model.view_of_camera(camera, index))
    inside = (depth > 0) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    rows, columns = outputs["depth"].shape[:2]
    row = (v.nan_to_num().clamp(0, 1) * rows).long().clamp(max=rows - 1)
    column = (u.nan_to_num().clamp(0, 1) * columns).long().clamp(max=columns - 1)
    shown = inside & (depth <= (1 + SAME_DEPTH) * outputs["depth"][row, column, 0])
    if "distractor_mask" in outputs:
        shown &= ~outputs["distractor_mask"][row, column, 0]
    return shown, torch.stack([u, v], dim=-1)


def alone(
    names: Sequence[str], shown: Bool[Tensor, "V P"], places: Float[Tensor, "V P 2"]
) -> list[Alone]:
    """Photos of which no other photo shows more than `MUCH`; those that show most alone first.

    Args:
        shown: which points each shows.
        places: where in the photo, as shares of its width and height.
    """
    lonely = shown & (shown.sum(dim=0) == 1)
    photos = []
    for name, of_photo, visible, where in zip(names, lonely, shown, places, strict=True):
        share = float(of_photo.sum() / visible.sum().clamp(min=1))
        if share > MUCH:
            u, v = where[of_photo].mean(dim=0).tolist()
            across = "left" if u < 0.4 else "right" if u > 0.6 else ""
            along = "upper" if v < 0.4 else "lower" if v > 0.6 else ""
            photos.append(Alone(name, share, f"{along} {across}".strip() or "middle"))
    return sorted(photos, key=lambda photo: -photo.share)
