"""A small model with an appearance model or a background."""

from __future__ import annotations

from typing import Any

import torch

from desplat_ns.effects import EffectsConfig
from desplat_ns.model import DeSplatModel
from tests.helpers.small_model import make_model


def model_with(appearance: str = "off", background: bool = False, **config: Any) -> DeSplatModel:
    effects = EffectsConfig(appearance=appearance, background=background)  # type: ignore[arg-type]
    return make_model(effects=effects, **config)


def moved(model: DeSplatModel) -> DeSplatModel:
    """As if trained: embeddings that differ, heads that are not zero."""
    assert model.image_effects is not None
    generator = torch.Generator().manual_seed(5)
    for parameter in model.image_effects.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape, generator=generator)
    return model
