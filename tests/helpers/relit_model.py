"""A small model with an appearance model or a background."""

from __future__ import annotations

from typing import Any

import torch
from nerfstudio.cameras.cameras import Cameras

from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.config import AppearanceConfig
from desplat_ns.settings.effects import EffectsConfig
from tests.helpers.small_model import HEIGHT, WIDTH, make_model


def model_with(appearance: str = "off", background: str = "off", **config: Any) -> DeSplatModel:
    """What its networks give counts in full, so that a few steps or small weights show."""
    config.setdefault("appearance", AppearanceConfig(mlp_scale=1.0))
    effects = EffectsConfig(appearance=appearance, background=background)  # type: ignore[arg-type]
    return make_model(effects=effects, **config)


def moved(model: DeSplatModel) -> DeSplatModel:
    """As if trained: embeddings that differ, heads that are not zero."""
    generator = torch.Generator().manual_seed(5)
    for parameter in model.image_effects.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape, generator=generator)
    return model


def held_out(width: int = WIDTH) -> Cameras:
    pose = torch.eye(4)[:3]
    pose[2, 3] = 3.0
    return Cameras(pose[None], 20.0, 20.0, WIDTH / 2, HEIGHT / 2, width, HEIGHT)


def photo_in_the_light_of(model: DeSplatModel, view: int, width: int = WIDTH) -> torch.Tensor:
    with model.shown_light.fixed(model.image_effects.of(view)):
        return model.get_outputs_for_camera(held_out(width))["rgb"]
