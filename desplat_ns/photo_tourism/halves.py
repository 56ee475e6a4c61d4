"""The protocol of Photo Tourism: an image's embedding from its left half, figures from its right.

What the right half shows never reaches the embedding: the fit is given the left columns only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float, Shaped
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.ssim import ssim
from desplat_ns.errors import CaptureError, ConfigError
from desplat_ns.evaluation.records import ScoredImage
from desplat_ns.evaluation.stopwatch import Stopwatch
from desplat_ns.rendering.views import view_of

MIN_WIDTH = 4
"""Pixels of a photo whose halves can be scored: SSIM needs two each way."""


@dataclass
class EvaluationConfig:
    """How images are scored. Saved with the run, so that plain `ns-eval` follows it."""

    protocol: Literal["auto", "half", "full"] = "auto"
    """half: optimize the image's embedding on its left half, score its right half (B.1). full:
    score the whole image in the training images' average light. auto: half where there is an
    appearance model, else full."""
    steps: int = 128
    """Steps of Adam for an embedding. B.3."""
    learning_rate: float = 0.01
    """Of the embedding. B.3."""
    load_embeddings: Path | None = None
    """Take the embeddings from this file (of `save_embeddings`) instead of optimizing them."""
    save_embeddings: Path | None = None
    """Write the test images' embeddings into this file (.npz)."""


def uses_halves(config: EvaluationConfig, appearance: str) -> bool:
    """Whether evaluation goes by halves.

    Raises:
        ConfigError: halves are asked for, but there is no appearance model; or steps or rate are
            out of range.
    """
    if config.steps < 0 or not 0 < config.learning_rate < math.inf:
        raise ConfigError(
            f"An embedding takes 0 or more steps at a positive learning rate; found --steps "
            f"{config.steps} and --learning-rate {config.learning_rate}. B.3 has 128 at 0.01."
        )
    if config.protocol == "half" and appearance == "off":
        raise ConfigError(
            "The half protocol optimizes an image's embedding, and this model has none: its "
            "effects.appearance is off. Evaluate by `desplat-eval --protocol full`, or train with "
            "`--pipeline.model.effects.appearance affine`."
        )
    halves = config.protocol == "half" or (config.protocol == "auto" and appearance != "off")
    files = [path for path in (config.load_embeddings, config.save_embeddings) if path is not None]
    if files and not halves:
        raise ConfigError(
            f"Embeddings of test images are to be read from or written to '{files[0]}', but whole "
            "images are scored, without any. Leave the file out, or take the half protocol of a "
            "model with appearance."
        )
    return halves


def left_half(image: Shaped[Tensor, "H W C"]) -> Shaped[Tensor, "H left C"]:
    """Columns [:W // 2].

    Source: App. B.1; for odd W the column in the middle belongs to the right half.
    """
    return image[:, : image.shape[1] // 2]


def right_half(image: Shaped[Tensor, "H W C"]) -> Shaped[Tensor, "H right C"]:
    """Columns [W // 2:].

    Source: App. B.1.
    """
    return image[:, image.shape[1] // 2 :]


def photometric_loss(
    image: Float[Tensor, "H W 3"], photo: Float[Tensor, "H W 3"], ssim_weight: float
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w D-SSIM.

    Source: L_GS, the photometric term of Eq. 5 and 12.
    """
    l1 = (image - photo).abs().mean()
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - ssim(image, photo))


def fit_embedding(
    loss: Callable[[Float[Tensor, " E"]], Float[Tensor, ""]],
    start: Float[Tensor, " E"],
    steps: int,
    learning_rate: float,
) -> Float[Tensor, " E"]:
    """The embedding after `steps` of Adam on `loss`; nothing else gets a gradient.

    Source: B.3, test-time optimization.
    """
    with torch.enable_grad():
        embedding = start.detach().clone().requires_grad_()
        optimizer = torch.optim.Adam([embedding], lr=learning_rate)
        for _ in range(steps):
            (embedding.grad,) = torch.autograd.grad(loss(embedding), embedding)
            optimizer.step()
    return embedding.detach()


def embedding_from_left_half(
    model: Any,
    camera: Cameras,
    photo: Float[Tensor, "H W 3"],
    config: EvaluationConfig,
    mask: Shaped[Tensor, "H W 1"] | None = None,
) -> Float[Tensor, " E"]:
    """The embedding that explains the left half of a photo best.

    The model is in eval mode and stays bit-identical. The start is the average of the training
    images' embeddings. The whole view is drawn: half of it would be cut at another border, where
    EWA bounds and culls Gaussians differently (1e-3 of colour).

    Args:
        model: a `DeSplatModel` with an appearance model.
        photo: the whole photo; columns from W // 2 on are not looked at.
        mask: of the whole photo; what it leaves out does not count, as in training.

    Raises:
        CaptureError: the photo is narrower than `MIN_WIDTH`.
    """
    view = view_of(camera)
    if view.width < MIN_WIDTH:
        raise CaptureError(
            f"A photo to evaluate is {view.width} pixels wide; its halves need {MIN_WIDTH // 2} "
            "each. Leave it out of the test images, or evaluate by `desplat-eval --protocol full`."
        )
    draw, ssim_weight = model.as_function_of_embedding(view), model.config.ssim_lambda
    seen = 1.0 if mask is None else left_half(mask.to(photo))
    target = left_half(photo) * seen
    return fit_embedding(
        lambda embedding: photometric_loss(left_half(draw(embedding)) * seen, target, ssim_weight),
        model.image_effects.embeddings.mean(),
        config.steps,
        config.learning_rate,
    )


def score_right_half(
    model: Any, camera: Cameras, batch: dict[str, Any], embedding: Float[Tensor, " E"] | None
) -> tuple[dict[str, float], dict[str, Tensor]]:
    """Figures of the right half, and the whole photo beside the whole rendering.

    Args:
        embedding: the image's; None for the training images' average light.
    """
    light = nullcontext() if embedding is None else model.worn.fixed(embedding)
    with light:
        outputs = model.get_outputs_for_camera(camera)
    right = {name: right_half(outputs[name]) for name in ("rgb", "background")}
    figures, _ = model.get_image_metrics_and_images(
        right, {**batch, "image": right_half(batch["image"])}
    )
    photo = model.composite_with_background(model.get_gt_img(batch["image"]), outputs["background"])
    return figures, {"img": torch.cat([photo, outputs["rgb"]], dim=1)}


@dataclass
class HalvesProtocol:
    """Scores test images one by one by their halves, and keeps their embeddings."""

    config: EvaluationConfig
    known: dict[str, Tensor] = field(default_factory=dict)
    """Embeddings by image name that are taken instead of optimized."""
    embeddings: dict[str, Tensor] = field(default_factory=dict)
    """By image name, of the images scored so far."""

    def describe(self) -> str:
        """The protocol in words, for the JSON."""
        how = f"{self.config.steps} steps of Adam at {self.config.learning_rate:g} on its left half"
        if self.config.load_embeddings is not None:
            how = f"loaded from {self.config.load_embeddings.name}"
        return f"right half, static Gaussians only; each image's embedding: {how}"

    def score(
        self, model: Any, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, Tensor]]:
        """One image: figures with its own embedding, and as `*_before` in the average light.

        Raises:
            ConfigError: embeddings were loaded, and this image has none.
            CaptureError: see `embedding_from_left_half`.
        """
        watch = Stopwatch(model.device)
        watch.start()
        average = model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        before, _ = score_right_half(model, camera, batch, None)
        watch.start()
        self.embeddings[name] = self._embedding(model, camera, batch, name, average["background"])
        fit_seconds = watch.seconds()
        watch.start()
        figures, pictures = score_right_half(model, camera, batch, self.embeddings[name])
        figures |= {f"{key}_before": value for key, value in before.items()}
        figures["embedding_seconds"] = fit_seconds
        height, width = average["rgb"].shape[:2]
        return ScoredImage(name, width, height, figures, render_seconds, watch.seconds()), pictures

    def _embedding(
        self, model: Any, camera: Cameras, batch: dict[str, Any], name: str, behind: Tensor
    ) -> Tensor:
        if self.config.load_embeddings is None:
            photo = model.composite_with_background(model.get_gt_img(batch["image"]), behind)
            mask = batch.get("mask")
            return embedding_from_left_half(model, camera, photo, self.config, mask)
        if name not in self.known:
            raise ConfigError(
                f"{self.config.load_embeddings} holds no embedding of '{name}', only of "
                f"{', '.join(sorted(self.known)) or 'no image'}. Save the embeddings of this run's "
                "test images first: `desplat-eval --save-embeddings FILE`."
            )
        return self.known[name]
