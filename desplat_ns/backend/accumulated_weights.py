"""How much of an image each Gaussian makes up."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import Rasterizer, RenderSettings, Splats, View


def accumulated_weights(
    rasterizer: Rasterizer,
    splats: Splats,
    view: View,
    settings: RenderSettings,
    columns: int | None = None,
) -> Float[Tensor, " N"]:
    """Sum over pixels of each Gaussian's blending weight alpha_i T_i, in pixels, >= 0, whatever
    their colours: the derivative by c_i of the image's sum. `columns`: so many of the image's first
    ones count; all if None."""
    white = torch.ones_like(splats.means).requires_grad_()
    shape = (splats.means, splats.quats, splats.scales, splats.opacities)
    alone = Splats(*(each.detach() for each in shape), colors=white)
    with torch.enable_grad():
        rendered = rasterizer(alone, view, replace(settings, depth=False, absgrad=False))
        (gradient,) = torch.autograd.grad(rendered.rgb[:, :columns, 0].sum(), white)
    return gradient[:, 0]
