"""Which photos to take next: where a place is seen by one training photo alone.

What one photo shows and no other one contradicts nobody can check: its depth is not known, and
whatever stood in the way would be taken for the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.console import list_names
from desplat_ns.pipeline import DeSplatPipeline
from desplat_ns.rendering.near_plane import sampled
from desplat_ns.rendering.views import image_points

PLACES = 4_000
"""Opaque static Gaussians that are asked for, evenly chosen."""

MOST_PHOTOS = 200
"""Training photos; with more nothing is said: to look at all takes minutes, and of some of them no
one can say what they show alone."""

SAME_DEPTH = 0.1
"""Share of a depth by which a Gaussian may lie behind what is seen there, and be seen itself."""

MUCH = 0.1
"""Share of what a photo shows. Photos that show more than this alone are named."""

MAX_NAMES = 3


@dataclass(frozen=True)
class Alone:
    """A photo that shows something alone."""

    name: str
    share: float
    """Of what it shows of the scene."""
    side: str
    """Where in the photo that lies, in words."""


def seen_alone(pipeline: DeSplatPipeline) -> list[Alone]:
    """Training photos that show much of the scene alone; those that show most first."""
    model, manager = pipeline.model, pipeline.datamanager
    names = manager.train_image_names
    opaque = torch.sigmoid(model.opacities[:, 0]) > 0.5
    points = sampled(model.means[opaque], PLACES)
    if len(points) == 0 or not 2 <= len(names) <= MOST_PHOTOS:
        return []
    shown, places = zip(*(_shown(pipeline, points, i) for i in range(len(names))), strict=True)
    return alone(names, torch.stack(shown), torch.stack(places))


@torch.no_grad()
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
    """Photos that show more than `MUCH` of what they show alone; those that show most first.

    Args:
        names: of the photos.
        shown: which points each shows.
        places: where in the photo, as shares of its width and height.
    """
    lonely = shown & (shown.sum(dim=0) == 1)
    photos = []
    for name, of_photo, visible, where in zip(names, lonely, shown, places, strict=True):
        share = float(of_photo.sum() / visible.sum().clamp(min=1))
        if share > MUCH:
            photos.append(Alone(name, share, side_of(where[of_photo])))
    return sorted(photos, key=lambda photo: -photo.share)


def side_of(places: Float[Tensor, "P 2"]) -> str:
    """Which part of a photo these places lie in, in words."""
    u, v = places.mean(dim=0).tolist()
    across = "left" if u < 0.4 else "right" if u > 0.6 else ""
    along = "upper" if v < 0.4 else "lower" if v > 0.6 else ""
    return " ".join(filter(None, (along, across))) or "middle"


def in_words(photos: Sequence[Alone]) -> tuple[str, str]:
    """What is seen by one photo alone, and what to do about it; empty where nothing is."""
    if not photos:
        return "", ""
    said = [f"{photo.name} ({100 * photo.share:.0f}%, {photo.side} part)" for photo in photos]
    return (
        f"Parts of the scene that one photo alone shows: {list_names(said, MAX_NAMES)}.",
        "The next photos are worth most there: step to the side of where these were taken, and "
        "look at that part.",
    )
