"""One view under the light of several images, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8
from nerfstudio.cameras.cameras import Cameras
from PIL import Image

from desplat_ns.errors import ConfigError
from desplat_ns.evaluation.pictures import sheet


@torch.no_grad()
def appearance_strip(
    model: Any, camera: Cameras, name: str, images: Sequence[int], photos: Sequence[np.ndarray]
) -> UInt8[np.ndarray, "H W 3"]:
    """A sheet: above, training photos; below, the view of `camera` in the light of each.

    Args:
        model: a `DeSplatModel` with an appearance model, in eval mode.
        camera: one camera, of the photo called `name`.
        images: numbers of training views.
        photos: theirs, [H, W, 3] of 8 bit.

    Raises:
        ConfigError: the model has no appearance model.
    """
    if not model.effects.image_light:
        raise ConfigError(
            "A strip shows one view in the light of several photos, and this model has none: its "
            "effects.appearance is off. Leave out --strip."
        )
    pictures = []
    for image in images:
        with model.shown_light.fixed(model.image_effects.of(image)):
            pictures.append(model.get_outputs_for_camera(camera)["rgb"].cpu().numpy())
    height, width = pictures[0].shape[:2]
    titles = [
        model.shown_light.names[i] if model.shown_light.names else f"view {i}" for i in images
    ]
    above = [_fitted(photo, width, height) for photo in photos]
    rows = [("training photos", above), (f"{name} in their light", pictures)]
    return sheet(rows, titles, "One view under several appearances")


def _fitted(photo: np.ndarray, width: int, height: int) -> np.ndarray:
    """The photo as large as it fits, on white."""
    scale = min(width / photo.shape[1], height / photo.shape[0])
    size = (max(1, round(photo.shape[1] * scale)), max(1, round(photo.shape[0] * scale)))
    canvas = Image.new("RGB", (width, height), "white")
    small = Image.fromarray(photo).resize(size, Image.Resampling.BOX)
    canvas.paste(small, ((width - size[0]) // 2, (height - size[1]) // 2))
    return np.asarray(canvas)
