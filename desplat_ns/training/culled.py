"""Counts Gaussians that no view can show any more, and says when they are too many."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.backend.inputs import sound
from desplat_ns.backend.protocol import RenderSettings, Splats
from desplat_ns.console import announce
from desplat_ns.gaussians.activation import MAX_LOG_SCALE

TOO_WIDE = math.exp(MAX_LOG_SCALE) / 2
"""World units. Wider Gaussians are culled in every view."""

COUNT_INTERVAL = 100
"""Steps from one count to the next; at least a round of the views."""

MAX_CULLED_SHARE = 0.5
"""A static scene of which more than this share can be drawn in no view is no scene any more."""


@torch.no_grad()
def culled_always(splats: Splats) -> Bool[Tensor, " N"]:
    """Which Gaussians no view shows: not `sound`, beyond the far plane, or wider than `TOO_WIDE`.

    A backend culls them with a gradient of 0, so they never come back.
    """
    away = splats.means.abs().amax(-1) >= RenderSettings.far_plane
    return ~sound(splats) | away | (splats.scales.amax(-1) > TOO_WIDE)


def too_many_culled(culled: int, count: int) -> str | None:
    """What is wrong, in words, if most static Gaussians are culled in every view; else None."""
    if culled <= MAX_CULLED_SHARE * count:
        return None
    return f"{culled} of {count} static Gaussians hold values that no view can show"


class CulledCount:
    """The number of Gaussians that no view shows, as last counted; announced the first time."""

    def __init__(self, num_views: int):
        self.interval = max(COUNT_INTERVAL, num_views)
        self.static = self.distractors = 0
        self._said = False

    def take(self, step: int, static: int, distractors: int) -> None:
        """Take the counts after `step`."""
        self.static, self.distractors = static, distractors
        if static + distractors > 0 and not self._said:
            self._said = True
            announce(
                f"Step {step}: {static} static Gaussians and {distractors} distractors "
                "hold values that no view can show (not finite, or far beyond any scene). They are "
                "culled and never come back. A learning rate may be too high; TensorBoard has "
                "their number as culled_static and culled_distractors.",
                warning=True,
            )
