"""Scores one image: in a light, and on a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import torch
from jaxtyping import Float, Shaped
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.evaluated_model import EvaluatedModel
from desplat_ns.evaluation.halves import embedding_from_left_half, right_half
from desplat_ns.evaluation.records import ScoredImage
from desplat_ns.evaluation.stopwatch import Stopwatch

Region = Literal["full image", "right half"]


@dataclass
class LeftHalfLight:
    """An image's light, as its left half asks for it.

    Source: App. B.1, the protocol of Photo Tourism.
    """

    model: EvaluatedModel
    config: EvaluationConfig

    def describe(self) -> str:
        """How it is found, in words."""
        if self.model.effects.closed_form:
            return "in closed form on its left half"
        steps, rate = self.config.steps, self.config.learning_rate
        return f"{steps} steps of Adam at {rate:g} on its left half"

    def of(
        self, camera: Cameras, batch: dict[str, Any], behind: Float[Tensor, "H W 3"]
    ) -> Float[Tensor, " E"]:
        """The embedding of an image.

        Args:
            behind: what shows where the photo is transparent.

        Raises:
            CaptureError: see `embedding_from_left_half`.
        """
        config, model = self.config, self.model
        photo = model.composite_with_background(model.get_gt_img(batch["image"]), behind)
        options = config.steps, config.learning_rate, _counted(batch)
        return embedding_from_left_half(model, camera, photo, *options)


def _counted(batch: dict[str, Any]) -> Shaped[Tensor, "H W 1"] | None:
    """The mask of a photo, without what is transparent in it; None if all of it counts."""
    image, mask = batch["image"], batch.get("mask")
    if image.shape[2] < 4:
        return mask
    opaque = image[..., 3:] > 0
    return opaque if mask is None else opaque & (mask.to(opaque.device) != 0)


@dataclass
class Scorer:
    """One way to score images."""

    model: EvaluatedModel
    region: Region = "full image"
    """Which pixels count."""
    light: LeftHalfLight | None = None
    """Each image's own; None: the training images' average."""

    def describe(self) -> str:
        """The way in words, for the JSON."""
        text = f"{self.region}, static Gaussians only"
        if self.light is not None:
            return f"{text}; each image's embedding: {self.light.describe()}"
        return text if self.region == "full image" else f"{text}; no embedding of the image's own"

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of one image, those in the average light as `*_before` if it has its own, and
        the photo beside the rendering, [H, W, 3] in [0, 1] by name.

        Args:
            camera: of the image.
            batch: the photo, as nerfstudio's datamanager gives it.
            name: of the photo.

        Raises as `LeftHalfLight.of`.
        """
        model, watch = self.model, Stopwatch(self.model.device)
        watch.start()
        outputs = model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        figures, pictures = self._figures(outputs, batch)
        if self.light is not None:
            before = {f"{key}_before": value for key, value in figures.items()}
            watch.start()
            embedding = self.light.of(camera, batch, outputs["background"])
            before["embedding_seconds"] = watch.seconds()
            watch.start()
            with model.shown_in(embedding):
                outputs = model.get_outputs_for_camera(camera)
            figures, pictures = self._figures(outputs, batch)
            figures |= before
        height, width = outputs["rgb"].shape[:2]
        return ScoredImage(name, width, height, figures, render_seconds, watch.seconds()), pictures

    def _figures(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Of the region, and the whole photo beside the whole rendering."""
        model = self.model
        if self.region == "full image":
            return model.get_image_metrics_and_images(outputs, batch)
        right = {name: right_half(outputs[name]) for name in ("rgb", "background")}
        half = {**batch, "image": right_half(batch["image"])}
        figures, _ = model.get_image_metrics_and_images(right, half)
        photo = model.get_gt_img(batch["image"])
        photo = model.composite_with_background(photo, outputs["background"])
        return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}
