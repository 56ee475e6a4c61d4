"""The per-image effects that are on, together: the light of each image, appearance, background."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.core.effects import Effects
from desplat_ns.core.options import check_ranges
from desplat_ns.photo_tourism.appearance import (
    EMBEDDING_DIM,
    AffineAppearance,
    ShAppearance,
    as_harmonics,
)
from desplat_ns.photo_tourism.background import (
    BACKGROUND_DEGREE,
    Background,
    SharedBackground,
    background_image,
)
from desplat_ns.photo_tourism.camera_response import (
    CENTRED,
    NUMBERS,
    camera_response,
    squared_radius,
)
from desplat_ns.photo_tourism.config import AppearanceConfig

FEATURES = "appearance_features"
"""Name of z_i among the static Gaussians' parameters, where every split, clone and prune finds
them."""

INITIAL_STD = 0.01
"""Standard deviation of the embeddings at the start: nearly alike, but not equal."""


class ImageEffects(nn.Module):
    """What an image's embedding changes: the static colours, the finished picture, the background.

    The embedding [E] of an image is all that is known of its light: the numbers of its camera's
    response, then what the networks of appearance and background read, as far as these are on. Both
    are dense parameters, which Adam's momentum moves on after the step that saw the image; B.3's
    rate is made for it.
    """

    def __init__(
        self, effects: Effects, appearance: AppearanceConfig, num_images: int, sh_degree: int
    ):
        """Build what `effects` asks for; `sh_degree` is of the static Gaussians. Raises ConfigError
        for sizes that no model can have."""
        check_ranges(appearance, "--pipeline.model.appearance")
        super().__init__()
        self.responses: nn.Parameter | None = None
        """Of the cameras [V, 5]."""
        self.embeddings: nn.Parameter | None = None
        """The e_j [V, `EMBEDDING_DIM`]."""
        self.appearance: AffineAppearance | ShAppearance | None = None
        self.background: Background | SharedBackground | None = None
        if effects.appearance == "camera":
            self.responses = nn.Parameter(torch.zeros(num_images, NUMBERS))
        if effects.image_embeddings:
            start = INITIAL_STD * torch.randn(num_images, EMBEDDING_DIM)
            self.embeddings = nn.Parameter(start)
        if effects.appearance == "affine":
            self.appearance = AffineAppearance(appearance)
        elif effects.appearance == "sh":
            self.appearance = ShAppearance(appearance, sh_degree)
        if effects.background == "image":
            self.background = Background()
        elif effects.background != "off":
            degree = BACKGROUND_DEGREE if effects.background == "sh" else 0
            self.background = SharedBackground(degree)

    def of(self, image: int | None) -> Float[Tensor, " E"]:
        """The embedding of a training image; with None the training images' average light, for an
        image that was not trained on; empty if images do not differ."""
        tables = [table for table in (self.responses, self.embeddings) if table is not None]
        parts = [table.mean(dim=0) if image is None else table[image] for table in tables]
        return torch.cat(parts) if parts else torch.zeros(0)

    def apply_appearance(
        self, splats: Splats, features: Float[Tensor, "N Z"], embedding: Float[Tensor, " E"]
    ) -> Splats:
        """All static Gaussians in the colours of the image that `embedding` describes, for a file;
        for a picture `appearance.in_view` is quicker."""
        splats = as_harmonics(splats)
        assert self.appearance is not None and splats.sh_degree is not None
        colors = self.appearance(embedding, features, splats.colors, splats.sh_degree)
        return replace(splats, colors=colors)

    def apply_camera_response(
        self, colors: Float[Tensor, "... 3"], view: View, embedding: Float[Tensor, " E"]
    ) -> Float[Tensor, "... 3"]:
        """Colours >= 0 of the static scene, one [3] or an image [H, W, 3], as the image's camera
        shows them."""
        numbers = embedding[:NUMBERS]
        if self.responses is None or not (self.training or numbers.any()):
            return colors
        return camera_response(colors, numbers, squared_radius(view))

    def background_of(
        self, embedding: Float[Tensor, " E"], view: View, degree: int
    ) -> Float[Tensor, "H W 3"] | Float[Tensor, " 3"]:
        """The background of the image that `embedding` describes, seen from `view`; [3] in training
        if it has one colour. `degree` is cut to that of the background."""
        assert self.background is not None
        coefficients = self.background(embedding[-EMBEDDING_DIM:])
        degree = min(degree, self.background.degree)
        if degree == 0:
            color = (C0 * coefficients[0] + 0.5).clamp(0, 1)
            return color if self.training else color.expand(view.height, view.width, 3)
        return background_image(coefficients, view, degree)

    @torch.no_grad()
    def after_step(self) -> None:
        """Keep the average camera's response at no change, after an optimizer step (`CENTRED`)."""
        if self.responses is not None:
            self.responses[:, :CENTRED] -= self.responses[:, :CENTRED].mean(dim=0)

    def param_groups(self) -> dict[str, list[nn.Parameter]]:
        """An optimizer group for each learning rate; none for what is off."""
        groups: dict[str, list[nn.Parameter]] = {}
        if self.responses is not None:
            groups["camera_responses"] = [self.responses]
        if self.embeddings is not None:
            groups["image_embeddings"] = [self.embeddings]
        if self.appearance is not None:
            groups["appearance_mlp"] = list(self.appearance.parameters())
        if self.background is not None:
            # B.3 has a rate for each part: background_encoder, background_sh_dc, background_sh_rest
            for name, parameter in self.background.named_parameters():
                groups.setdefault(f"background_{name.split('.')[0]}", []).append(parameter)
        return groups
