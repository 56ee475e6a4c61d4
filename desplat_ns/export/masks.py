"""Distractor masks over the photos as they lie on disk, grown and coloured as others want them.

Letters in shapes: H x W pixels of the photo.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from jaxtyping import Bool

from desplat_ns.export.lens import pinhole_of
from desplat_ns.export.photos import Photo
from desplat_ns.model import DeSplatModel
from desplat_ns.rendering.layers import MASK_THRESHOLD


@torch.no_grad()
def distractor_mask(model: DeSplatModel, photo: Photo) -> Bool[np.ndarray, "H W"]:
    """Where the distractors of a training photo cover it, at its full size.

    A run without distractors has none to ask for. The threshold is that of all masks (App. C.1).
    """
    assert model.layer is not None
    pinhole = pinhole_of(photo.camera)
    view = model.view_of_camera(pinhole.camera.to(model.device), photo.index)
    settings = model.render_settings(depth=False)
    drawn = model.layer.draw(photo.index, lambda splats: model.rasterizer(splats, view, settings))
    alpha = np.zeros((view.height, view.width), np.float32)
    if drawn is not None:
        alpha = drawn.alpha[..., 0].cpu().numpy()
    return pinhole.to_photo(alpha) > MASK_THRESHOLD


def dilated(mask: Bool[np.ndarray, "H W"], pixels: float) -> Bool[np.ndarray, "H W"]:
    """All pixels whose centre is at most so many pixels from that of a pixel of the mask."""
    if pixels == 0 or not mask.any():
        return mask
    outside = np.ascontiguousarray(~mask, dtype=np.uint8)
    return cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= pixels
