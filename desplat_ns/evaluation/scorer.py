"""Scores one image: in a light, and on a region."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.errors import ConfigError
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.halves import embedding_from_left_half, right_half
from desplat_ns.model import DeSplatModel
from desplat_ns.settings.options import check_ranges

Region = Literal["full image", "right half"]


@dataclass
class ScoredImage:
    """One evaluated image."""

    name: str
    width: int
    height: int
    metrics: dict[str, float]
    """As the model's `get_image_metrics_and_images` gives them."""
    render_seconds: float
    """Rendering alone."""
    total_seconds: float
    """Rendering and metrics."""


@dataclass
class Scorer:
    """One way to score images."""

    model: DeSplatModel
    region: Region = "full image"
    """Which pixels count."""
    fit: EvaluationConfig | None = None
    """How each image's light is found on its left half, the protocol of Photo Tourism (App. B.1);
    None: it is the training images' average."""

    @classmethod
    def of(cls, model: DeSplatModel, config: EvaluationConfig) -> Scorer:
        """The scorer that the options ask for.

        Raises:
            ConfigError: halves are asked for, but images have no embedding; or steps or rate are
                out of range.
        """
        check_ranges(config, "-")
        has_light = model.effects.image_light
        if config.protocol == "half" and not has_light:
            raise ConfigError(
                "The half protocol finds an image's embedding, and this model has none: its "
                "effects.appearance is off. Evaluate by `desplat-eval --protocol full`, or train "
                "with `--pipeline.model.effects.appearance affine`."
            )
        if config.protocol == "half" or (config.protocol == "auto" and has_light):
            return cls(model, "right half", config)
        return cls(model, "right half" if config.protocol == "right" else "full image")

    def describe(self) -> str:
        """The way in words, for the JSON."""
        text = f"{self.region}, static Gaussians only"
        if self.fit is None:
            whole = self.region == "full image"
            return text if whole else f"{text}; no embedding of the image's own"
        how = f"{self.fit.steps} steps of Adam at {self.fit.learning_rate:g}"
        how = "in closed form" if self.model.effects.closed_form else how
        return f"{text}; each image's embedding: {how} on its left half"

    def score(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """Figures of one image, those in the average light as `*_before` if it has its own, and
        the photo beside the rendering, [H, W, 3] in [0, 1] by name.

        Args:
            camera: of the image.
            batch: the photo, as nerfstudio's datamanager gives it.
            name: of the photo.

        Raises:
            CaptureError: see `embedding_from_left_half`.
        """
        model, start = self.model, self._now()
        outputs = model.get_outputs_for_camera(camera)
        render_seconds = self._now() - start
        figures, pictures = self._figures(outputs, batch)
        if self.fit is not None:
            before = {f"{key}_before": value for key, value in figures.items()}
            start = self._now()
            photo, mask = model.photo_of(outputs, batch), batch.get("mask")
            if batch["image"].shape[2] == 4:  # what is transparent does not count
                opaque = batch["image"][..., 3:] > 0
                mask = opaque if mask is None else opaque & (mask.to(opaque.device) != 0)
            embedding = embedding_from_left_half(model, camera, photo, self.fit, mask)
            before["embedding_seconds"] = self._now() - start
            start = self._now()
            with model.shown_in(embedding):
                outputs = model.get_outputs_for_camera(camera)
            figures, pictures = self._figures(outputs, batch)
            figures |= before
        height, width = outputs["rgb"].shape[:2]
        seconds = self._now() - start
        return ScoredImage(name, width, height, figures, render_seconds, seconds), pictures

    def _now(self) -> float:
        """Seconds; what the GPU was given is done."""
        if self.model.device.type == "cuda":
            torch.cuda.synchronize(self.model.device)
        return time.perf_counter()

    def _figures(
        self, outputs: dict[str, Tensor], batch: dict[str, Any]
    ) -> tuple[dict[str, float], dict[str, Tensor]]:
        """Of the region, and the whole photo beside the whole rendering."""
        if self.region == "full image":
            return self.model.get_image_metrics_and_images(outputs, batch)
        right = {name: right_half(outputs[name]) for name in ("rgb", "background")}
        half = {**batch, "image": right_half(batch["image"])}
        figures, _ = self.model.get_image_metrics_and_images(right, half)
        photo = self.model.photo_of(outputs, batch)
        return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}
