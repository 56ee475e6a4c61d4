"""The 3D points at which static Gaussians start."""

from __future__ import annotations

import math

from torch import Tensor, nn

from desplat_ns.errors import CaptureError

MIN_SEED_POINTS = 4
"""Splatfacto sizes each Gaussian by its three nearest neighbours."""

MIN_SEED_SCALE = 1e-6
"""World units. Coincident 3D points have neighbours at distance 0, whose logarithm is no scale."""


def check_seed_points(seeds: tuple[Tensor, Tensor] | None) -> None:
    """Raise CaptureError where there are too few; None, which makes Splatfacto draw its own, is
    fine.

    Args:
        seeds: points [P, 3] and their colours [P, 3].
    """
    if seeds is not None and len(seeds[0]) < MIN_SEED_POINTS:
        raise CaptureError(
            f"The capture has {len(seeds[0])} 3D points; static Gaussians start at the points of "
            f"the reconstruction and need at least {MIN_SEED_POINTS}. Give a reconstruction with "
            "points, or add `--pipeline.model.random-init True`."
        )


def clamp_seed_scales(params: nn.ParameterDict) -> None:
    """Give coincident points a size: `scales` (logarithms) of at least `MIN_SEED_SCALE`."""
    params["scales"].data.clamp_(min=math.log(MIN_SEED_SCALE))
