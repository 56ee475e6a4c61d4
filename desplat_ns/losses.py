"""The opacity terms of Eq. 5.

The photometric term of Eq. 5, (1 - w) L1 + w D-SSIM with w = 0.2, is Splatfacto's and stays there.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor


def distractor_opacity_loss(alpha_d: Float[Tensor, "H W 1"]) -> Float[Tensor, ""]:
    """Mean opacity of the distractors, in [0, 1]: what they explain has its price.

    Source: Eq. 5, the term weighted by lambda_d.
    """
    return alpha_d.mean()


def static_transparency_loss(alpha_s: Float[Tensor, "H W 1"]) -> Float[Tensor, ""]:
    """Mean transparency of the static scene, in [0, 1]: it should fill the image by itself.

    Source: Eq. 5, the term weighted by lambda_s.
    """
    return (1 - alpha_s).mean()
