"""The interfaces between an evaluation, its protocol and the model."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.evaluation.records import ScoredImage


@runtime_checkable
class ScoredModel(Protocol):
    """A model whose images are scored: nerfstudio's, as Splatfacto fills it in."""

    @property
    def device(self) -> torch.device:
        """Device of its parameters."""
        ...

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, Tensor]:
        """Images [H, W, C] of one camera, `rgb` and `background` among them; no gradients."""
        ...

    def get_image_metrics_and_images(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Figures of one image, and pictures [H, W, 3] by name."""
        ...

    def get_gt_img(self, image: Tensor) -> Tensor:
        """A photo as the model is compared with it, in [0, 1]."""
        ...

    def composite_with_background(self, image: Tensor, background: Tensor) -> Tensor:
        """A photo, over the background where it is transparent."""
        ...


@runtime_checkable
class EvaluationProtocol(Protocol):
    """One way to score a test image."""

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        ...

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of one image, and pictures [H, W, 3] in [0, 1] by name.

        Args:
            camera: of the image.
            batch: the photo, as nerfstudio's datamanager gives it.
            name: of the photo.
        """
        ...
