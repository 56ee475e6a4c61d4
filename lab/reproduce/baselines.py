"""What `desplat` is compared with, besides itself with effects switched off.

They are not registered; nerfstudio's commands find them by
NERFSTUDIO_METHOD_CONFIGS='masked-by-truth=lab.reproduce.baselines:by_truth'.
"""

import copy
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F
from nerfstudio.plugins.types import MethodSpecification
from PIL import Image
from torch import Tensor

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import GT_MASKS
from desplat_ns.data.images import read_gt_mask
from desplat_ns.data.robustnerf import kind_of
from desplat_ns.losses import photometric_losses
from desplat_ns.method_configs import desplat
from desplat_ns.model import DeSplatModel
from desplat_ns.model_config import DeSplatModelConfig

SHADOWS_PREFIX = "shadow_"
"""The folder of shadow masks stands beside that of the masks; before its name there is this."""

TRIMMED_SHARE = 0.8
"""Share of a photo's pixels that the robust baseline trusts in every step."""

TRUSTED_NEIGHBOURS = 0.5
"""A pixel counts where more than this share of the 3 x 3 around it is trusted."""


@dataclass
class MaskedConfig(DeSplatModelConfig):
    """The static scene alone, trained on a part of each photo."""

    _target: type = field(default_factory=lambda: TrustedPixelsModel)
    by_truth: bool = False
    """Leave out the pixels of the true masks and shadows; otherwise those of a trimmed residual."""


class TrustedPixelsModel(DeSplatModel):
    """Splatfacto's loss where a mask lets it."""

    config: MaskedConfig  # pyright: ignore[reportIncompatibleVariableOverride]

    def get_loss_dict(
        self, outputs: dict[str, Any], batch: dict[str, Any], metrics_dict: Any = None
    ) -> dict[str, Tensor]:
        """Splatfacto's, its photometric part on the trusted pixels only."""
        losses = super().get_loss_dict(outputs, batch, metrics_dict)
        if self.training:
            photo = self.photo_of(outputs["background"], batch["image"])
            owned = self._truth(photo) if self.config.by_truth else _trimmed(outputs["rgb"], photo)
            losses["main_loss"], *_ = photometric_losses(
                photo, owned.to(photo.dtype), self.config.ssim_lambda, outputs["rgb"]
            )
        return losses

    def _truth(self, photo: Tensor) -> Tensor:
        """True masks and shadows [H, W, 1] of the view just drawn: any pixel they touch."""
        assert self.train_step is not None
        path = mask_of(self.kwargs["metadata"], self.train_step.index)
        if path is None:
            return torch.zeros_like(photo[..., :1], dtype=torch.bool)
        shadow = shadow_mask_of(path)
        mask = _any_pixel(path, photo)
        return mask if shadow is None else mask | _any_pixel(shadow, photo)


def shadow_mask_of(mask: Path) -> Path | None:
    """The mask of the shadows that go with a mask, white where one is; None if there is none.

    Of masks/a/b.png it is shadow_masks/a/b.png.
    """
    for folder in mask.parents[:-1]:
        beside = folder.with_name(SHADOWS_PREFIX + folder.name) / mask.relative_to(folder)
        if beside.is_file():
            return beside
    return None


def mask_of(metadata: dict[str, Any], index: int) -> Path | None:
    """The true mask of a training photo, by its number; None where it has none and its name says
    that it is clean.

    Raises:
        CaptureError: it has none and may show anything; the message names the photo.
    """
    masks = metadata.get(GT_MASKS)
    path = masks[index] if masks else None
    if path is None:
        names = metadata.get("train_image_names", [])
        photo = names[index] if index < len(names) else f"number {index}"
        if kind_of(photo) == "clean":
            return None
        raise CaptureError(
            f"The training photo {photo} has no true mask, and this baseline leaves out what true "
            "masks show. Add a .png of its name to the capture's `masks` folder, black where "
            "nothing is in the way."
        )
    return path


def _any_pixel(path: Path, photo: Tensor) -> Tensor:
    """A mask [H, W, 1] by the evaluation's rule at the photo's size: any pixel that it touches."""
    with Image.open(path) as image:
        width, height = image.size
    mask = read_gt_mask(path, width, height)[..., 0].to(photo.device, torch.float32)
    return F.adaptive_max_pool2d(mask[None, None], photo.shape[:2])[0, 0, :, :, None] > 0


def _trimmed(rendered: Tensor, photo: Tensor) -> Tensor:
    """Pixels [H, W, 1] that a trimmed, 3 x 3 smoothed residual leaves out."""
    residual = (rendered.detach() - photo).abs().mean(-1)
    trusted = (residual <= residual.flatten().quantile(TRIMMED_SHARE)).to(photo.dtype)
    share = F.avg_pool2d(trusted[None], 3, 1, 1, count_include_pad=False)[0]
    return (share <= TRUSTED_NEIGHBOURS)[..., None]


def _method(name: str, by_truth: bool) -> MethodSpecification:
    config: Any = copy.deepcopy(desplat.config)
    config.method_name = name
    model = config.pipeline.model
    taken = {field.name: getattr(model, field.name) for field in fields(model)}
    taken |= {"_target": TrustedPixelsModel, "effects": EffectsConfig(distractors=False)}
    taken |= {"opacity_prior": 0.0}  # Splatfacto charges nothing
    config.pipeline.model = MaskedConfig(**taken, by_truth=by_truth)
    return MethodSpecification(
        config=config, description="Splatfacto on a part of each photo, to compare with."
    )


by_truth = _method("masked-by-truth", True)
by_residual = _method("masked-by-residual", False)
