"""Activates raw parameters, which optimizers change, into the splats that a rasterizer takes."""

from collections.abc import Mapping

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.protocol import Splats

RawParameters = nn.ParameterDict | Mapping[str, Tensor]
"""Values before activation, by name."""

MAX_LOG_SCALE = 80.0
"""exp of more (88.7) overflows float32, and the 0 that comes back for a culled Gaussian would
become NaN. The torch and numba backends cull a scale of e^80."""


def activate_static(params: RawParameters, sh_degree: int | None) -> Splats:
    """Static Gaussians with Splatfacto's activations: exp(scales), sigmoid(opacities), SH colours.

    Args:
        params: Splatfacto's `gauss_params`: means [N, 3], scales [N, 3] (log), quats [N, 4],
            features_dc [N, 3], features_rest [N, K - 1, 3], opacities [N, 1] (logit).
        sh_degree: degree to evaluate now; None where colours are stored as logits, without SH.
    """
    if sh_degree is None:
        colors = sigmoid(params["features_dc"])
    else:
        colors = torch.cat([params["features_dc"][:, None], params["features_rest"]], dim=1)
    return _activate(params, colors, sh_degree)


def activate_distractors(params: RawParameters) -> Splats:
    """Distractor Gaussians of one view: `params` as above, with rgbs [N, 3] in [0, 1] as colours.

    Source: App. A, "RGB Colour Representation for Distractor Gaussians".
    """
    return _activate(params, params["rgbs"], None)


def _activate(params: RawParameters, colors: Tensor, sh_degree: int | None) -> Splats:
    """What both sets have in common. Scales are finite for whatever is finite, and have no gradient
    beyond MAX_LOG_SCALE."""
    return Splats(
        means=params["means"],
        quats=params["quats"],
        # a clamp, whose gradient is one operation instead of three
        scales=torch.exp(F.hardtanh(params["scales"], -torch.inf, MAX_LOG_SCALE)),
        opacities=sigmoid(params["opacities"]).squeeze(-1),
        colors=colors,
        sh_degree=sh_degree,
    )


def sigmoid(logits: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """1 / (1 + exp(-x)), with the same bits for any number of threads: `torch.sigmoid` (2.15)
    rounds the last few elements of each thread's share differently on a CPU."""
    return _Sigmoid.apply(logits) if logits.is_cpu else torch.sigmoid(logits)  # type: ignore[return-value]


class _Sigmoid(torch.autograd.Function):
    """Never overflows: with e = exp(-|x|), 1 / (1 + e) or e / (1 + e)."""

    @staticmethod
    def forward(ctx, x):  # type: ignore[override]
        e = torch.exp(-x.abs())
        y = torch.where(x >= 0, 1.0, e) / (1 + e)
        ctx.save_for_backward(y)
        return y

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):  # type: ignore[override]
        (y,) = ctx.saved_tensors
        return grad * y * (1 - y)
