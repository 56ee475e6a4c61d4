"""The static Gaussians of a model as a file holds them: after activation, in one light."""

from __future__ import annotations

import torch
from torch import Tensor

from desplat_ns.backend.constants import ALPHA_CUTOFF
from desplat_ns.backend.protocol import Splats
from desplat_ns.errors import ConfigError
from desplat_ns.export.splat_cloud import MAX_DEGREE, SplatCloud
from desplat_ns.photo_tourism.lit_splats import as_harmonics
from desplat_ns.training.culled import culled_always


def baked(splats: Splats, antialiased: bool) -> SplatCloud:
    """Gaussians of a model as a file holds them.

    Left out is what no view shows: what a backend culls always, and what is fainter than a pixel's
    cut-off everywhere. Coefficients that are not evaluated yet are left out, too, and those above
    degree `MAX_DEGREE`.

    Args:
        splats: activated, with the colours of one light.
        antialiased: as `SplatCloud.antialiased`.

    Raises:
        ConfigError: nothing is left.
    """
    splats = as_harmonics(splats)
    assert splats.sh_degree is not None
    shown = ~culled_always(splats) & (splats.opacities >= ALPHA_CUTOFF)
    if not shown.any():
        raise ConfigError(
            f"Of {len(shown)} static Gaussians no view shows any: there is nothing to export. "
            "Train longer, or take an earlier checkpoint."
        )
    bases = (min(splats.sh_degree, MAX_DEGREE) + 1) ** 2
    quats = torch.nn.functional.normalize(splats.quats, dim=-1)

    def array(values: Tensor):
        return values[shown].detach().cpu().numpy()

    return SplatCloud(
        means=array(splats.means.double()),
        quats=array(quats),
        scales=array(splats.scales),
        opacities=array(splats.opacities),
        harmonics=array(splats.colors[:, :bases]),
        antialiased=antialiased,
    )
