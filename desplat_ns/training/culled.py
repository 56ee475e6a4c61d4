"""Gaussians that no view can show any more, and when they are too many."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.backend.constants import FAR_PLANE
from desplat_ns.backend.inputs import is_finite
from desplat_ns.backend.protocol import Splats
from desplat_ns.gaussians.activation import MAX_LOG_SCALE

TOO_WIDE = math.exp(MAX_LOG_SCALE) / 2
"""World units. Wider Gaussians are culled in every view."""

MAX_CULLED_SHARE = 0.5
"""A static scene of which more than this share can be drawn in no view is no scene any more."""


@torch.no_grad()
def culled_always(splats: Splats) -> Bool[Tensor, " N"]:
    """Which Gaussians no view shows: broken, beyond the far plane, or wider than `TOO_WIDE`.

    A backend culls them with a gradient of 0, so they never come back.
    """
    away = splats.means.abs().amax(-1) >= FAR_PLANE
    return ~is_finite(splats) | away | (splats.scales.amax(-1) > TOO_WIDE)


def too_many_culled(culled: int, count: int) -> str | None:
    """What is wrong, in words, if most static Gaussians are culled in every view; else None."""
    if culled <= MAX_CULLED_SHARE * count:
        return None
    return f"{culled} of {count} static Gaussians hold values that no view can show"
