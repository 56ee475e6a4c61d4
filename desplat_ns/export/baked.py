"""The static Gaussians of a model as a file holds them: after activation, in one light."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF, FAR_PLANE
from desplat_ns.backend.inputs import is_finite
from desplat_ns.backend.protocol import Splats
from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import MAX_DEGREE, SplatCloud
from desplat_ns.gaussians.activation import MAX_LOG_SCALE
from desplat_ns.photo_tourism.lit_splats import as_harmonics

TOO_WIDE = math.exp(MAX_LOG_SCALE) / 2
"""World units. Wider Gaussians are culled in every view."""


@torch.no_grad()
def shown_anywhere(splats: Splats) -> Bool[Tensor, " N"]:
    """Which Gaussians some view may show: none that are broken, beyond the far plane, wider than
    `TOO_WIDE`, or fainter than a pixel's cut-off."""
    near = splats.means.abs().amax(-1) < FAR_PLANE
    drawn = near & (splats.scales.amax(-1) <= TOO_WIDE) & (splats.opacities >= ALPHA_CUTOFF)
    return is_finite(splats) & drawn


def baked(splats: Splats, antialiased: bool) -> SplatCloud:
    """Gaussians of a model as a file holds them, those that are `shown_anywhere`.

    Args:
        splats: activated, with the colours of one light.
        antialiased: as `SplatCloud.antialiased`.

    Raises:
        ConfigError: nothing is left.
    """
    shown = shown_anywhere(splats)
    if not shown.any():
        raise ConfigError(
            f"Of {len(shown)} static Gaussians no view shows any: there is nothing to export. "
            "Train longer, or take an earlier checkpoint."
        )
    splats = splats.rows(shown)
    quats = torch.nn.functional.normalize(splats.quats, dim=-1)

    def array(values: Tensor):
        return values.detach().cpu().numpy()

    return SplatCloud(
        means=array(splats.means.double()),
        quats=array(quats),
        scales=array(splats.scales),
        opacities=array(splats.opacities),
        harmonics=harmonics_of(splats),
        antialiased=antialiased,
    )


def harmonics_of(splats: Splats) -> Float[np.ndarray, "N K 3"]:
    """Coefficients as a file holds them: without those that are not evaluated yet, and those above
    degree `MAX_DEGREE`."""
    splats = as_harmonics(splats)
    assert splats.sh_degree is not None
    bases = (min(splats.sh_degree, MAX_DEGREE) + 1) ** 2
    return splats.colors[:, :bases].detach().cpu().numpy()
