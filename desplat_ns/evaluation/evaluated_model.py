"""What an evaluation needs of a model."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Protocol, runtime_checkable

import torch
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor, nn

from desplat_ns.backend import Rasterizer
from desplat_ns.backend.protocol import View
from desplat_ns.evaluation.metrics import LazyLpips
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.settings.effects import Effects


@runtime_checkable
class EvaluatedModel(Protocol):
    """nerfstudio's model as Splatfacto fills it in, and what `DeSplatModel` adds.

    Letters in shapes: H x W pixels, E numbers of an embedding. What takes or gives an embedding is
    called only if the effects have a light for each image.
    """

    config: Any
    """Has `ssim_lambda`, `sh_degree` and `num_downscales`."""
    gauss_params: nn.ParameterDict
    """Of the static set."""
    effects: Effects
    image_effects: ImageEffects | None
    lpips: LazyLpips
    shown_light: ShownLight
    layer_control: Any
    """`viewer.LayerControl`."""

    @property
    def device(self) -> torch.device:
        """Of its parameters."""
        ...

    @property
    def distractors(self) -> DistractorGaussians | None:
        """Those of all training views; None if the effect is off."""
        ...

    @property
    def rasterizer(self) -> Rasterizer:
        """The backend."""
        ...

    def update_to_step(self, step: int) -> None:
        """Take up a checkpoint's step."""
        ...

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, Tensor]:
        """Images [H, W, C] of one camera, `rgb` and `background` among them, with distractors also
        `alpha_distractor` and `distractor_mask` [H, W, 1]; no gradients."""
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

    def as_function_of_embedding(
        self, view: View, columns: int | None = None
    ) -> Callable[[Tensor], Tensor]:
        """The static scene [H, W, 3] seen from `view`, given an image embedding [E]; where
        `columns` is given, no more than as many of the first columns need to be right."""
        ...

    def embedding_in_closed_form(self, view: View, photo: Tensor, seen: Tensor) -> Tensor:
        """The embedding [E] that explains a photo [H, W, 3] best in the pixels `seen` [H, W]. Call
        it only if the effects have one."""
        ...

    def average_embedding(self) -> Tensor:
        """The mean [E] of the training images' embeddings."""
        ...

    def shown_in(self, embedding: Tensor) -> AbstractContextManager[None]:
        """Within, every image that is drawn outside of training has this embedding [E]."""
        ...
