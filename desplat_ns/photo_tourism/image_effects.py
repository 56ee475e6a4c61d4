"""The per-image effects that are on, together: the light of each image, appearance, background."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.photo_tourism.appearance import AffineAppearance, ShAppearance
from desplat_ns.photo_tourism.background import (
    Background,
    SharedBackground,
    background_image,
)
from desplat_ns.photo_tourism.camera_response import (
    CameraResponses,
    camera_response,
    squared_radius,
)
from desplat_ns.photo_tourism.config import AppearanceConfig, BackgroundConfig
from desplat_ns.photo_tourism.embeddings import ImageTable, image_embeddings
from desplat_ns.photo_tourism.lit_splats import Lit, as_harmonics, lit_splats
from desplat_ns.settings.effects import Effects
from desplat_ns.settings.options import check_ranges

FEATURES = "appearance_features"
"""Name of z_i among the static Gaussians' parameters, where every split, clone and prune finds
them."""


class ImageEffects(nn.Module):
    """What an image's embedding changes: the static colours, the finished picture, the background.

    The embedding [E] of an image is all that is known of its light: the numbers of its camera's
    response, or what the networks of appearance and background read.
    """

    def __init__(
        self,
        effects: Effects,
        appearance: AppearanceConfig,
        background: BackgroundConfig,
        num_images: int,
        sh_degree: int,
    ):
        """Build what `effects` asks for.

        Args:
            num_images: training images.
            sh_degree: of the static Gaussians.

        Raises:
            ConfigError: sizes that no model can have.
        """
        check_ranges(appearance, "--pipeline.model.appearance")
        check_ranges(background, "--pipeline.model.background")
        super().__init__()
        self.responses = CameraResponses(num_images) if effects.appearance == "camera" else None
        self.embeddings: ImageTable | None = None
        if effects.image_embeddings:
            self.embeddings = image_embeddings(num_images, appearance.embedding_dim)
        self.appearance: AffineAppearance | ShAppearance | None = None
        if effects.appearance == "affine":
            self.appearance = AffineAppearance(appearance)
        elif effects.appearance == "sh":
            self.appearance = ShAppearance(appearance, sh_degree)
        self.background: Background | SharedBackground | None = None
        if effects.background == "image":
            self.background = Background(background, appearance.embedding_dim)
        elif effects.background != "off":
            self.background = SharedBackground(
                background.sh_degree if effects.background == "sh" else 0
            )

    # --- lights ------------------------------------------------------------------------------

    def of(self, image: int) -> Float[Tensor, " E"]:
        """The embedding of a training image; empty if images do not differ."""
        return self._joined([table.of(image) for table in self._tables()])

    def mean(self) -> Float[Tensor, " E"]:
        """The training images' average light: that of an image that was not trained on."""
        return self._joined([table.mean() for table in self._tables()])

    def _tables(self) -> list[ImageTable]:
        return [table for table in (self.responses, self.embeddings) if table is not None]

    def _joined(self, parts: list[Tensor]) -> Tensor:
        return torch.cat(parts) if parts else torch.zeros(0)

    def _numbers(self, embedding: Float[Tensor, " E"]) -> Float[Tensor, " 5"]:
        """The part of an embedding that `responses` holds."""
        assert self.responses is not None
        return embedding[: self.responses.weight.shape[1]]

    def _read_by_networks(self, embedding: Float[Tensor, " E"]) -> Tensor:
        """The part of an embedding that `embeddings` holds."""
        assert self.embeddings is not None
        return embedding[-self.embeddings.weight.shape[1] :]

    # --- what they change --------------------------------------------------------------------

    def apply_appearance(
        self, splats: Splats, features: Float[Tensor, "N Z"], embedding: Float[Tensor, " E"]
    ) -> Splats:
        """All static Gaussians in the colours of the image that `embedding` describes.

        Args:
            features: z_i.
        """
        if self.appearance is None:
            return splats
        splats = as_harmonics(splats)
        assert splats.sh_degree is not None
        read = self._read_by_networks(embedding)
        colors = self.appearance(read, features, splats.colors, splats.sh_degree)
        return replace(splats, colors=colors)

    def apply_camera_response(
        self, colors: Float[Tensor, "... 3"], view: View, embedding: Float[Tensor, " E"]
    ) -> Float[Tensor, "... 3"]:
        """Colours of the static scene, one [3] or an image [H, W, 3], as the image's camera shows
        them.

        Args:
            colors: >= 0.
        """
        if self.responses is None:
            return colors
        numbers = self._numbers(embedding)
        if not self.training and not numbers.any():
            return colors
        return camera_response(colors, numbers, squared_radius(view))

    def appearance_in_view(
        self,
        splats: Splats,
        features: Float[Tensor, "N Z"],
        view: View,
        frozen: bool = False,
    ) -> Lit:
        """Static Gaussians as a view shows them, given an embedding [E]; quicker than
        `apply_appearance`.

        Args:
            features: z_i.
            frozen: whether nothing but the embedding is to get a gradient.
        """
        assert self.appearance is not None
        appearance = deepcopy(self.appearance).requires_grad_(False) if frozen else self.appearance
        lit = lit_splats(appearance, splats, features, view)
        return lambda embedding: lit(self._read_by_networks(embedding))

    def background_of(
        self, embedding: Float[Tensor, " E"], view: View, degree: int
    ) -> Float[Tensor, "H W 3"] | Float[Tensor, " 3"]:
        """The background of the image that `embedding` describes, seen from `view`; [3] in training
        if it has one colour.

        Call it where there is one only. `degree` is cut to that of the background.
        """
        assert self.background is not None
        if isinstance(self.background, Background):
            coefficients = self.background(self._read_by_networks(embedding))
        else:
            coefficients = self.background()
        degree = min(degree, self.background.degree)
        if degree == 0:
            color = (C0 * coefficients[0] + 0.5).clamp(0, 1)
            return color if self.training else color.expand(view.height, view.width, 3)
        return background_image(coefficients, view, degree)

    # --- training ----------------------------------------------------------------------------

    def after_step(self) -> None:
        """Keep the average camera's response at no change, after an optimizer step."""
        if self.responses is not None:
            self.responses.centre()

    def param_groups(self) -> dict[str, list[nn.Parameter]]:
        """An optimizer group for each learning rate; none for what is off."""
        groups: dict[str, list[nn.Parameter]] = {}
        if self.responses is not None:
            groups["camera_responses"] = [self.responses.weight]
        if self.embeddings is not None:
            groups["image_embeddings"] = list(self.embeddings.parameters())
        if self.appearance is not None:
            groups["appearance_mlp"] = list(self.appearance.parameters())
        return groups if self.background is None else groups | self.background.param_groups()
