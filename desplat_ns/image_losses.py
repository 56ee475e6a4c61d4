"""Which terms a step's images are charged, and how much each counts; `losses` has the terms.

What is charged beside the images (poses, responses, scales, opacities of Gaussians) is in
`DeSplatModel.regularizers`.
"""

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.core.effects import Effects
from desplat_ns.distractors.placement import distractor_weight
from desplat_ns.losses import (
    background_opacity_loss,
    distractor_opacity_loss,
    explained_by_background,
    photometric_losses,
    static_transparency_loss,
)
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.step import Step

LAMBDA_BG = 0.15
"""Weight of L_bg, Eq. 12. B.3."""


def image_losses(
    step: Step, outputs: dict[str, Any], config: DeSplatModelConfig, effects: Effects
) -> dict[str, Float[Tensor, ""]]:
    """The terms of Eq. 5 and 12, and the one that `distractors.static_alone` adds, of a step that
    was compared with its photo. `outputs`: of `DeSplatModel.get_outputs` in training."""
    own, sky, mask = config.distractors, effects.background, step.mask
    alpha_s = outputs["accumulation"]
    alpha_d = outputs["alpha_distractor"] if effects.distractors else torch.zeros_like(alpha_s)
    if mask is not None:  # in what it leaves out nothing is drawn, and nothing is missing
        alpha_s, alpha_d = alpha_s.where(mask, 1.0), alpha_d.where(mask, 0.0)
    weight = None
    if effects.distractors and step.distractors is not None and own.static_alone:
        weight = distractor_weight(alpha_d, step.in_region)
        losses = _separate_losses(step, outputs, config, weight)
    else:
        losses = {"main_loss": main_loss(outputs["rgb"], step.photo, mask, config)}
    if effects.distractors:
        opacity = distractor_opacity_loss(alpha_d, step.in_region)
        losses["distractor_opacity"] = own.lambda_d * opacity
        # Before a photo's own sky, B.3 has 0.
        if sky == "off" or (sky != "image" and weight is not None):
            transparency = static_transparency_loss(alpha_s, None if sky == "off" else weight)
            losses["static_transparency"] = own.lambda_s * transparency
    if sky != "off":
        assert step.behind is not None
        explained = explained_by_background(step.behind, step.photo)
        explained = explained if mask is None else explained & mask
        opacity = background_opacity_loss(alpha_d, alpha_s, explained)
        losses["background_opacity"] = LAMBDA_BG * opacity
    return losses


def main_loss(
    image: Float[Tensor, "H W 3"],
    photo: Float[Tensor, "H W 3"],
    mask: Bool[Tensor, "H W 1"] | None,
    config: DeSplatModelConfig,
) -> Float[Tensor, ""]:
    """L_GS of an image; what is masked is black in it and in the photo."""
    if mask is not None:
        image, photo = image * mask, photo * mask
    return _photometric(photo, None, config, image)[0]


def _separate_losses(
    step: Step, outputs: dict[str, Any], config: DeSplatModelConfig, weight: Float[Tensor, "H W 1"]
) -> dict[str, Float[Tensor, ""]]:
    """L_GS of the composite, which moves distractors only, and of the static scene on what they do
    not own; in masked pixels the composite shows the static scene, as the photo does."""
    static, composite, mask = outputs["rgb_static"], outputs["rgb"], step.mask
    grows = step.nominal < config.stop_split_at
    leak = config.distractors.leak if grows else 0.0
    if mask is not None:  # windows reach across its border
        static, composite = (static.detach().where(~mask, i) for i in (static, composite))
    if config.use_bilateral_grid:  # the composite moves the grids everywhere
        (own,) = _photometric(step.photo, weight, config, static, leak=leak)
        (main,) = _photometric(step.photo, None, config, composite)
    else:
        own, main = _photometric(step.photo, weight, config, static, composite, leak=leak)
    return {"main_loss": main, "static_photometric": own}


def _photometric(
    photo: Tensor,
    weight: Tensor | None,
    config: DeSplatModelConfig,
    *images: Tensor,
    leak: float = 0.0,
) -> tuple[Tensor, ...]:
    """`photometric_losses`; backend `torch` has torch alone, to rule out what is compiled."""
    compiled = config.backend != "torch"
    return photometric_losses(
        photo, weight, config.ssim_lambda, *images, leak=leak, compiled=compiled
    )
