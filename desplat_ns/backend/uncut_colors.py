"""View-dependent colours before they are cut off at 0: what Eq. 7 of DeSplat tones.

Float32 by the kernels of the `numba` backend on a CPU and by gsplat's on CUDA, else in plain torch:
any device, any float dtype. Differentiable in the camera.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.gsplat_build import unavailable_reason
from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import sh_basis


def uncut_colors(
    splats: Splats, view: View, shown: Bool[Tensor, " N"]
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N 3"]]:
    """SH + 1/2 seen from `view`, negative ones too; 0, without gradients, where not `shown`. And
    the zeroth coefficients of all.

    Args:
        splats: with spherical harmonics.
    """
    assert splats.sh_degree is not None
    center = view.center
    means, coefficients = splats.means, splats.colors
    is_float32 = means.dtype == coefficients.dtype == torch.float32
    if is_float32 and means.device.type == "cuda" and unavailable_reason() is None:
        from gsplat import spherical_harmonics

        colors = spherical_harmonics(splats.sh_degree, means - center, coefficients, masks=shown)
        # Rows that are not shown hold whatever was in the memory.
        return torch.where(shown[:, None], colors + 0.5, 0.0), coefficients[:, 0]
    if is_float32 and means.device.type == "cpu" and not center.requires_grad:
        from desplat_ns.backend.numba_kernels.sh import EvaluateColors

        return EvaluateColors.apply(
            means, coefficients, shown.int(), center, splats.sh_degree, False
        )  # type: ignore[return-value]
    # Replaced before the length is divided by: 0 * inf in the backward pass is NaN.
    away = torch.where(shown[:, None], means - center, 1.0)
    basis = sh_basis(splats.sh_degree, torch.nn.functional.normalize(away, dim=-1))
    used = coefficients[:, : basis.shape[1]].masked_fill(~shown[:, None, None], 0)
    colors = torch.einsum("nk,nkc->nc", basis, used) + 0.5
    return colors.masked_fill(~shown[:, None], 0), coefficients[:, 0]
