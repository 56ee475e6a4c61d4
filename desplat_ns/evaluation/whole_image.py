"""Images scored in the average light, and the protocol that scores the whole of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.evaluation.protocol import ScoredModel
from desplat_ns.evaluation.records import ScoredImage
from desplat_ns.evaluation.stopwatch import Stopwatch


@dataclass
class AverageLight:
    """Scores images in the training images' average light; `figures` says which part of them."""

    model: ScoredModel

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of one image, and the photo beside the rendering."""
        watch = Stopwatch(self.model.device)
        watch.start()
        outputs = self.model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        figures, pictures = self.figures(outputs, batch)
        height, width = outputs["rgb"].shape[:2]
        return ScoredImage(name, width, height, figures, render_seconds, watch.seconds()), pictures

    def figures(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Figures of a rendering, and pictures [H, W, 3] by name."""
        raise NotImplementedError


@dataclass
class WholeImage(AverageLight):
    """Scores whole images."""

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        return "full image, static Gaussians only"

    def figures(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """As the model gives them."""
        return self.model.get_image_metrics_and_images(outputs, batch)
