"""The images that come out of the model: distractors over the static scene, the background last.

Source: alpha blending of premultiplied colours, c = c_front + (1 - alpha_front) c_behind.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.protocol import Rendering

MASK_THRESHOLD = 0.5
"""A pixel counts as covered where the distractors' opacity is greater. App. C.1."""


def composite_alpha(
    alpha_d: Float[Tensor, "H W 1"], alpha_s: Float[Tensor, "H W 1"]
) -> Float[Tensor, "H W 1"]:
    """Opacity of the distractors drawn over the static scene, in [0, 1]: the summand of Eq. 9."""
    return alpha_d + (1 - alpha_d) * alpha_s


def over_background(
    rgb: Float[Tensor, "H W 3"],
    alpha: Float[Tensor, "H W 1"],
    background: Float[Tensor, "*background 3"],
) -> Float[Tensor, "H W 3"]:
    """A layer, weighted by its alpha already, over what lies behind it: distractors over the static
    scene, or both over a background of one colour or one per pixel.

    Source: c = c_d + (1 - alpha_d) c_s, DeSplat, Sec. 3. With `composite_alpha` the background's
    weight is (1 - alpha_d) (1 - alpha_s).
    """
    return rgb + (1 - alpha) * background


def in_range(image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W C"]:
    """Colours clamped to [0, 1], to within 1e-37. The gradient is 0 from 1 on and below 0; at 0 it
    passes: all that is shown may be black, and become lighter. On a CPU it takes a third of the
    time of `torch.clamp`'s."""
    return F.hardtanh(image, -1e-37, 1.0)


def static_outputs(
    static: Rendering, image: Float[Tensor, "H W 3"], background: Float[Tensor, "*background 3"]
) -> dict[str, Tensor]:
    """rgb [H, W, 3] in [0, 1], accumulation [H, W, 1], background, and depth if it was rendered:
    where nothing is, depth [H, W, 1] (world units) is that of the farthest pixel, as Splatfacto's.

    `image`: the static scene over the background, as the photo shows it; colours beyond 1 are cut
    here.
    """
    outputs = {
        "rgb": in_range(image),
        "accumulation": static.alpha,
        "background": background,
    }
    if static.depth is not None:
        farthest = static.depth.detach().max()
        outputs["depth"] = torch.where(static.alpha > 0, static.depth, farthest)
    return outputs


def layered_outputs(
    image: Float[Tensor, "H W 3"], rgb: Float[Tensor, "H W 3"], distractor: Rendering | None
) -> dict[str, Tensor]:
    """The distractors' layer and the composite, [H, W, C] with colours in [0, 1].

    rgb_composite, distractors over the static scene; rgb_distractor (weighted by its alpha, on
    black); alpha_distractor; distractor_mask (bool). Without distractors (None) their layer is
    empty. `image` is that of `static_outputs`, and `rgb` what it gave.
    """
    if distractor is None:
        nothing = rgb.new_zeros(()).expand_as(rgb)  # takes no memory
        composite, rgb_d, alpha_d = rgb, nothing, nothing[..., :1]
    else:
        rgb_d, alpha_d = distractor.rgb, distractor.alpha
        composite = in_range(over_background(rgb_d, alpha_d, image))
    return {
        "rgb_composite": composite,
        "rgb_distractor": rgb_d,
        "alpha_distractor": alpha_d,
        "distractor_mask": alpha_d > MASK_THRESHOLD,
    }
