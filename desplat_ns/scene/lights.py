"""A few of the photos' lights for a scene's page, where each photo has a light of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.console import text_of
from desplat_ns.export.baked import harmonics_of
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.lit_splats import as_harmonics
from desplat_ns.photo_tourism.shown_light import VARIABLE
from desplat_ns.runs.loading import even_subset
from desplat_ns.scene.contents import AVERAGE, Light

MORE = 3
"""Lights beside the one that is shown first."""

MOST_PHOTOS, MOST_GAUSSIANS = 300, 500
"""Photos among which lights are chosen, and Gaussians by whose colours they are compared; of more,
as many evenly chosen."""

ROUNDING = 1e-5
"""Share by which sums of a few hundred distances in float32 may differ though these are equal."""


def light_of(model: DeSplatModel, light: str | None) -> str:
    """Whose light a page shows; empty where all photos have the same.

    Of cameras' exposures (`camera`) it is always the average: they are no colours of Gaussians.
    """
    if not model.effects.image_light:
        return ""
    if model.effects.appearance == "camera":
        return AVERAGE
    return text_of(light or os.environ.get(VARIABLE) or AVERAGE)


def other_lights(model: DeSplatModel, rows: Tensor, view: View) -> list[Light]:
    """Lights of photos, so chosen that with the one that is shown they stand for those of all.

    None where the Gaussians have the same colours in every light.

    Args:
        rows: which Gaussians [N] of the model are on the page.
        view: for the background: its mean colour there stands for it.
    """
    effects = model.image_effects
    if effects.appearance is None or not model.names:
        return []
    photos = even_subset(len(model.names), MOST_PHOTOS)
    embeddings = [effects.of(photo) for photo in photos]
    shown = model.embedding_of(None)
    among = rows.nonzero()[:, 0]
    some = among[even_subset(len(among), MOST_GAUSSIANS)]
    first, *others = (_colors(model, some, embedding) for embedding in (shown, *embeddings))
    chosen = standing_for_all(torch.stack(others), first, MORE)
    return list(_baked(model, rows, view, [photos[i] for i in chosen]))


def standing_for_all(
    lights: Float[Tensor, "V C"], first: Float[Tensor, " C"], count: int
) -> list[int]:
    """Which of V lights to take beside the first one: one after the other, each such that all V are
    nearest to those that are taken, in the sum of their distances to the nearest one.

    Fewer than `count` if more would bring nothing nearer.
    """
    exact = "donot_use_mm_for_euclid_dist"  # by products, lights that are equal are 0.01 apart
    among = torch.cdist(lights, lights, compute_mode=exact)
    nearest, chosen = (lights - first).norm(dim=1), []
    while len(chosen) < count:
        left = torch.minimum(nearest, among).sum(dim=1)
        best = int(left.argmin())
        if not left[best] < (1 - ROUNDING) * nearest.sum():
            break
        chosen.append(best)
        nearest = torch.minimum(nearest, among[best])
    return chosen


def _colors(model: DeSplatModel, rows: Tensor, embedding: Tensor) -> Tensor:
    """Colours [C] of some Gaussians without view dependence, in [0, 1], one after the other."""
    with model.shown_in(embedding):
        lit = as_harmonics(model.shown_splats(rows))
    return (C0 * lit.colors[:, 0] + 0.5).clamp(0, 1).flatten()


def _baked(model: DeSplatModel, rows: Tensor, view: View, photos: Sequence[int]) -> Iterator[Light]:
    for photo in photos:
        embedding = model.image_effects.of(photo)
        with model.shown_in(embedding):
            harmonics = harmonics_of(model.shown_splats(rows))
        yield Light(text_of(model.names[photo]), mean_background(model, view, embedding), harmonics)


def mean_background(
    model: DeSplatModel, view: View, embedding: Tensor
) -> tuple[float, float, float]:
    """Colour in [0, 1] that stands for what is behind everything in a view."""
    colors = model.background_of(view, embedding).reshape(-1, 3)
    red, green, blue = colors.mean(dim=0).clamp(0, 1).tolist()
    return red, green, blue
