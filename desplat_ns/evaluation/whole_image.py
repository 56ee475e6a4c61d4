"""The protocol that scores whole images, for scenes in one light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.evaluation.protocol import ScoredModel
from desplat_ns.evaluation.records import ScoredImage
from desplat_ns.evaluation.stopwatch import Stopwatch


@dataclass
class WholeImage:
    """Scores whole images, in the training images' average light."""

    model: ScoredModel

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        return "full image, static Gaussians only"

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of one image, and the photo beside the rendering."""
        watch = Stopwatch(self.model.device)
        watch.start()
        outputs = self.model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        metrics, pictures = self.model.get_image_metrics_and_images(outputs, batch)
        height, width = outputs["rgb"].shape[:2]
        return ScoredImage(name, width, height, metrics, render_seconds, watch.seconds()), pictures
