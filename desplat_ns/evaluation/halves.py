"""Two protocols that score the right half of an image: with an embedding of its own, or without."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Shaped
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.protocol import ScoredModel
from desplat_ns.evaluation.records import ScoredImage
from desplat_ns.evaluation.stopwatch import Stopwatch
from desplat_ns.evaluation.whole_image import AverageLight
from desplat_ns.photo_tourism.halves import LitModel, embedding_from_left_half, right_half


@runtime_checkable
class ScoredLitModel(ScoredModel, LitModel, Protocol):
    """A model with embeddings whose images are scored."""


def _counted(batch: dict[str, Any]) -> Shaped[Tensor, "H W 1"] | None:
    """The mask of a photo, without what is transparent in it; None if all of it counts."""
    image, mask = batch["image"], batch.get("mask")
    if image.shape[2] < 4:
        return mask
    opaque = image[..., 3:] > 0
    return opaque if mask is None else opaque & (mask.to(opaque.device) != 0)


def score_right_half(
    model: ScoredModel, outputs: dict[str, Tensor], batch: dict[str, Any]
) -> tuple[dict[str, float], dict[str, Tensor]]:
    """Figures of the right half, and the whole photo beside the whole rendering.

    Args:
        outputs: the whole rendering.
    """
    right = {name: right_half(outputs[name]) for name in ("rgb", "background")}
    figures, _ = model.get_image_metrics_and_images(
        right, {**batch, "image": right_half(batch["image"])}
    )
    photo = model.composite_with_background(model.get_gt_img(batch["image"]), outputs["background"])
    return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}


@dataclass
class RightHalf(AverageLight):
    """Scores right halves in the training images' average light.

    For models without appearance, to be compared with others on the same pixels.
    """

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        return "right half, static Gaussians only; no embedding of the image's own"

    def figures(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """See `score_right_half`."""
        return score_right_half(self.model, outputs, batch)


@dataclass
class RightHalfByLeft:
    """Scores right halves, each image with the embedding that its left half asks for.

    Source: App. B.1, the protocol of Photo Tourism.
    """

    model: ScoredLitModel
    config: EvaluationConfig
    embeddings: dict[str, Tensor] = field(default_factory=dict)
    """By image name, of the images scored so far."""

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        how = f"{self.config.steps} steps of Adam at {self.config.learning_rate:g} on its left half"
        if self.model.effects.closed_form:
            how = "in closed form on its left half"
        return f"right half, static Gaussians only; each image's embedding: {how}"

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of the right half with the image's own embedding, `*_before` without.

        Raises:
            CaptureError: see `embedding_from_left_half`.
        """
        watch = Stopwatch(self.model.device)
        watch.start()
        average = self.model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        before, _ = score_right_half(self.model, average, batch)
        watch.start()
        self.embeddings[name] = self._embedding(camera, batch, average["background"])
        fit_seconds = watch.seconds()
        watch.start()
        with self.model.shown_in(self.embeddings[name]):
            outputs = self.model.get_outputs_for_camera(camera)
        figures, pictures = score_right_half(self.model, outputs, batch)
        figures |= {f"{key}_before": value for key, value in before.items()}
        figures["embedding_seconds"] = fit_seconds
        height, width = average["rgb"].shape[:2]
        return ScoredImage(name, width, height, figures, render_seconds, watch.seconds()), pictures

    def _embedding(
        self, camera: Cameras, batch: dict[str, Any], behind: Tensor
    ) -> Float[Tensor, " E"]:
        config, model = self.config, self.model
        photo = model.composite_with_background(model.get_gt_img(batch["image"]), behind)
        options = config.steps, config.learning_rate, _counted(batch)
        return embedding_from_left_half(model, camera, photo, *options)
