"""What lies around the cameras, for cropping: as far as they look, times a factor.

Letters in shapes: N Gaussians, V views.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.errors import ConfigError

SIDE = 64
"""Pixels of the longer side of the renderings whose depth is looked at."""

COVERED = 0.5
"""Opacity from which a pixel shows something at a depth."""


@dataclass(frozen=True)
class Surroundings:
    """Where cameras stand and how far they look, in world units."""

    places: Float[np.ndarray, "V 3"]
    reaches: Float[np.ndarray, " V"]
    """Median depth of what a view shows."""

    def within(self, means: Float[np.ndarray, "N 3"], factor: float) -> Bool[np.ndarray, " N"]:
        """Which points lie no farther from some camera than `factor` times that camera's reach."""
        kept = np.zeros(len(means), bool)
        for place, reach in zip(self.places, self.reaches, strict=True):
            kept |= np.square(means - place).sum(axis=1) <= (factor * reach) ** 2
        return kept


def surroundings_of(views: Iterable[View], rasterize: Callable[[View], Rendering]) -> Surroundings:
    """Look through small versions of the views.

    Args:
        rasterize: the static scene with its depth.

    Raises:
        ConfigError: no view shows anything.
    """
    places, reaches = [], []
    for view in views:
        reach = reach_of(view, rasterize)
        if reach is not None:
            places.append(view.center.double().cpu().numpy())
            reaches.append(reach)
    if not places:
        raise ConfigError(
            "No training view shows anything solid, so how far the cameras look is not known. "
            "Train longer, or leave out --crop."
        )
    return Surroundings(np.stack(places), np.array(reaches))


def reach_of(view: View, rasterize: Callable[[View], Rendering]) -> float | None:
    """Median depth of what a small version of a view shows, world units; None if that is nothing.

    Args:
        rasterize: the static scene with its depth.
    """
    rendering = rasterize(_reduced(view))
    assert rendering.depth is not None
    depths = rendering.depth[rendering.alpha > COVERED]
    return float(depths.median()) if len(depths) > 0 else None


def _reduced(view: View) -> View:
    """The same view with at most SIDE pixels a side."""
    factor = max(view.width, view.height) / SIDE
    scale = torch.tensor([1 / factor, 1 / factor, 1.0]).to(view.K)
    width, height = (max(1, round(side / factor)) for side in (view.width, view.height))
    return View(view.viewmat, view.K * scale[:, None], width, height)
